"""Figures of the documentation, each drawn by one program from a shipped scenario."""
