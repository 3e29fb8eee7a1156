"""Signs of block types in diagrams."""

from __future__ import annotations

from collections import defaultdict

from blocks.registry import registry
from flexarm.plotting.wiring.icons import SIZE, icon
from flexarm.plotting.wiring.shapes import Poly


def test_every_signal_block_has_a_sign_of_its_own() -> None:
    """Sources and controllers are told apart in a diagram, but for those that are one law."""
    seen = defaultdict(list)
    for name, made in registry().items():
        parts = made.__module__.split(".")
        folder = parts[1] if parts[0] == "blocks" else ""
        shapes = icon(name, folder, 0, 0)
        assert shapes, name
        for shape in shapes:
            if isinstance(shape, Poly):
                assert all(-1 <= a <= SIZE + 1 and -1 <= b <= SIZE + 1 for a, b in shape.points), name
        if folder in ("sources", "controllers"):
            seen[repr(shapes)].append(name)
    assert [names for names in seen.values() if len(names) > 1] == []
