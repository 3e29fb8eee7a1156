"""Trimming: the search for equilibria; see `engine.trim`."""
