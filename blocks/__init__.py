"""The block library: one physical thing per file, with its equation and sign convention on top."""

from blocks.registry import find, registry

__all__ = ["find", "registry"]
