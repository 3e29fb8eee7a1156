"""What long work says of itself where nobody sees a bar."""

from __future__ import annotations

import threading

import pytest

from flexarm.console import progress
from flexarm.console.progress import Progress, span


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_line_tells_share_time_and_what_is_left() -> None:
    clock = Clock()
    bar = Progress("arm: runs", clock=clock)
    clock.now += 30
    assert bar.line() == "arm: runs: 30 s so far"
    bar.update(0.25)
    assert bar.line() == "arm: runs: 25 %, 30 s so far, about 1 min 30 s left"
    bar.update(1.0)
    assert bar.line() == "arm: runs: 100 %, 30 s so far"
    bar.update(None, "starting")
    assert bar.line() == "arm: runs: starting: 30 s so far"
    bar.update(0.004)
    assert bar.line() == "arm: runs: 0.4 %, 30 s so far"


def test_what_is_left_is_that_of_the_part() -> None:
    clock = Clock()
    bar = Progress("arm", clock=clock)
    bar.update(0.0, "looking at effects")
    clock.now += 60
    bar.update(0.0, "trying effects")
    clock.now += 20
    bar.update(0.5, "trying effects")
    assert bar.line() == "arm: trying effects: 50 %, 1 min 20 s so far, about 20 s left of this part"


def test_lines_come_while_nobody_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 0.001)
    come, lines = threading.Event(), []

    def write(line: str) -> None:
        lines.append(line)
        come.set()

    with Progress("arm: fit", write=write):
        assert come.wait(60)
    assert lines[0].startswith("arm: fit: ")


def test_a_spare_one_is_silent_while_another_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "EVERY", 0.001)
    come = threading.Event()
    own: list[str] = []
    spare: list[str] = []

    def write(line: str) -> None:
        own.append(line)
        if len(own) > 20:
            come.set()

    with Progress("arm: fit", write=write), Progress("flexarm fit", write=spare.append, spare=True):
        assert come.wait(60)
    assert spare == []
    said = threading.Event()
    with Progress("flexarm run", write=lambda _: said.set(), spare=True):
        assert said.wait(60)


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (200, "3 min 20 s"), (7500, "2 h 5 min")])
def test_times_in_words(seconds: float, text: str) -> None:
    assert span(seconds) == text
