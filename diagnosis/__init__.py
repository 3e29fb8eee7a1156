"""Holding a model against recordings. Part of flexarm."""
