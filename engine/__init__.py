"""The engine: it turns equations into numbers and knows no particular block. Part of flexarm."""
