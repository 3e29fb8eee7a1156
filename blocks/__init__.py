"""The library: one physical thing per file, its equation and sign on top."""

from blocks.registry import find, registry

__all__ = ["find", "registry"]
