"""Showing how far long work has come."""

from __future__ import annotations

import sys
from typing import Any


class Progress:
    """A progress bar on stderr, if that is a terminal."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.bar: Any = None
        self.task: Any = None

    def __enter__(self) -> Progress:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress as Bar

            self.bar = Bar(console=Console(stderr=True), transient=True)
            self.task = self.bar.add_task(self.title, total=1.0)
            self.bar.start()
        return self

    def update(self, share: float) -> None:
        """Show the share done, from 0 to 1."""
        if self.bar is not None:
            self.bar.update(self.task, completed=share)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()
