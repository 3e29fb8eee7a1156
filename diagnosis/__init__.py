"""Holding a model against recordings."""
