"""The block library: one physical thing per file, with its equation and sign on top. Part of flexarm."""

from blocks.registry import find, registry

__all__ = ["find", "registry"]
