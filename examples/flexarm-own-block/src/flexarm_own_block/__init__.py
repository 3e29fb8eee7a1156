"""Blocks of our own for flexarm."""
