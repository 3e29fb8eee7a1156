"""Ground floor: how equations become numbers. Knows no particular block. Part of flexarm."""
