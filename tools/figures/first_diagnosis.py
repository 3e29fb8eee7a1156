"""Draw docs/tutorial/figures/held-out.png: a recording that nothing was fitted to, before and after the diagnosis.

Run ``python -m tools.figures.first_diagnosis``. It follows the tutorial to its last page, and keeps a picture that
``flexarm diagnose`` has written there.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from tools import console

TARGET = console.ROOT / "docs" / "tutorial" / "figures" / "held-out.png"
PAGES = ("first-arm.md", "own-arm.md", "linear-and-fmu.md", "first-diagnosis.md")
NEEDED = ("cp docs/tutorial/data", "cat recordings.yaml", "flexarm diagnose")
"""Commands that make what the picture needs; the others only show something."""

COLOURS = 64
"""In the picture: it has a few, and takes a quarter of the room with as many."""


def draw(target: Path = TARGET) -> Path:
    """Follow the pages in a temporary folder, and keep the picture of the held-out recording."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        console.prepare(folder)
        for page in PAGES:
            for step in console.steps((console.ROOT / "docs" / "tutorial" / page).read_text(encoding="utf-8")):
                if isinstance(step, console.File):
                    (folder / step.name).write_text(step.text, encoding="utf-8")
                elif step.line.startswith(NEEDED):
                    console.run(step, folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        with Image.open(folder / "found" / "held-out.png") as picture:
            picture.convert("RGB").quantize(COLOURS).save(target, optimize=True)
    return target


if __name__ == "__main__":
    print(draw())
