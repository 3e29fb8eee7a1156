"""Showing how far long work has come: a bar in a terminal, a line now and then where the output goes elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any, ClassVar

EVERY = 10.0
"""Seconds between lines where there is no terminal."""
FIRST_SHARE = 0.02
"""Share done from which the remaining time is guessed."""


class Progress:
    """A bar on stderr if that is a terminal; else, of work that takes longer, a line every `EVERY` seconds.

    Args:
        title: what is being done.
        clock: seconds that have passed.
        write: takes a line, where there is no terminal.
        spare: for work that may show its own progress: silent in a terminal, and while another is open.
    """

    _open: ClassVar[list[Progress]] = []

    def __init__(
        self,
        title: str,
        *,
        clock: Callable[[], float] = time.monotonic,
        write: Callable[[str], object] | None = None,
        spare: bool = False,
    ) -> None:
        self.title, self.what = title, ""
        self.bar: Any = None
        self.task: Any = None
        self._clock = clock
        self._write = write or (lambda line: print(line, file=sys.stderr, flush=True))
        self._share: float | None = None
        self._begun = self._phase = clock()
        self._spare = spare
        self._over = threading.Event()
        self._teller: threading.Thread | None = None

    def __enter__(self) -> Progress:
        self._begun = self._phase = self._clock()
        if not self._spare:
            self._open.append(self)
        if sys.stderr.isatty():
            if self._spare:
                return self
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
            self.bar = Bar(*columns, console=Console(stderr=True), transient=True)
            self.task = self.bar.add_task(self.title, total=None)
            self.bar.start()
        else:
            self._teller = threading.Thread(target=self._tell, daemon=True)
            self._teller.start()
        return self

    def update(self, share: float | None, what: str = "") -> None:
        """Show the share done, from 0 to 1, of the whole or, with ``what``, of one part of it; None if nobody knows."""
        if what != self.what:
            self.what, self._phase = what, self._clock()
        self._share = share
        if self.bar is not None:
            description = f"{self.title}: {what}" if what else self.title
            total = None if share is None else 1.0
            self.bar.update(self.task, description=description, completed=share or 0.0, total=total)

    def note(self, text: str) -> None:
        """Say something beside."""
        if self.bar is not None:
            self.bar.console.print(text, style="yellow", markup=False, highlight=False)
        else:
            self._write(text)

    def line(self) -> str:
        """How far the work has come, in words."""
        now = self._clock()
        head = f"{self.title}: {self.what}" if self.what else self.title
        parts = [f"{span(now - self._begun)} so far"]
        share = self._share
        if share is not None:
            parts.insert(0, f"{100 * share:.{1 if 0 < share < 0.1 else 0}f} %")
            if FIRST_SHARE <= share < 1:
                left = (now - self._phase) * (1 - share) / share
                parts.append(f"about {span(left)} left{' of this part' if self.what else ''}")
        return f"{head}: {', '.join(parts)}"

    def _tell(self) -> None:
        while not self._over.wait(EVERY):
            if not (self._spare and self._open):
                self._write(self.line())

    def __exit__(self, *_: object) -> None:
        if self in self._open:
            self._open.remove(self)
        self._over.set()
        if self._teller is not None:
            self._teller.join()
        if self.bar is not None:
            self.bar.stop()


def span(seconds: float) -> str:
    """A time in words: 45 s, 3 min 20 s, 2 h 5 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
