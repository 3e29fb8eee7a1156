"""Figures of a diagnosis: no legend over a curve, something to read for every place, and no backend chosen."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from diagnosis.api import diagnose
from diagnosis.search.posterior import place_odds
from diagnosis.verdict import figures
from tests.diagnosis.plants import case
from tests.diagnosis.search.test_resume import LEFT_OUT

DRAWN = ["held_out", "odds", "before_after", "recovered"]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return diagnose(case(tmp_path_factory.mktemp("bench"), coulomb=4.0e-4, seed=3), without=LEFT_OUT)


@pytest.fixture
def draw(found: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Draws a figure by name and gives it back as it was saved."""
    kept, save = [], figures._save

    def keep(figure: Any, path: Any) -> Any:
        kept.append(figure)
        return save(figure, path)

    def drawn(name: Any) -> Any:
        path = getattr(figures, name)(found, tmp_path / f"{name}.png")
        assert path.stat().st_size > 5000
        return kept[-1]

    monkeypatch.setattr(figures, "_save", keep)
    return drawn


@pytest.mark.parametrize("name", DRAWN)
def test_a_backend_that_was_chosen_stays(draw: Any, name: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(mpl.rcParams, "backend", "svg")
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)
    draw(name)
    assert mpl.get_backend() == "svg"
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize("name", DRAWN)
def test_no_legend_or_title_lies_over_anything(draw: Any, name: Any) -> None:
    figure = draw(name)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [legend.get_window_extent(renderer) for legend in figure.legends]
    boxes += [title.get_window_extent(renderer) for axis in figure.axes for title in _titles(axis) if title.get_text()]
    for axis in figure.axes:
        assert axis.get_legend() is None
        assert not any(box.overlaps(axis.get_window_extent(renderer)) for box in boxes)
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])


def _titles(axis: Any) -> tuple[Any, Any, Any]:
    return axis.title, axis._left_title, axis._right_title


def test_every_place_has_a_bar_and_its_odds(draw: Any, found: Any) -> None:
    axis = draw("odds").axes[0]
    places = list(place_odds(found.study.trials, found.study.odds))[: figures.PLACES]
    assert [label.get_text() for label in axis.get_yticklabels()] == places
    assert places
    left = axis.get_xlim()[0]
    assert all(bar.get_width() > left for bar in axis.patches)
    texts = [text.get_text() for text in axis.texts]
    assert texts[0] == "1"
    assert texts[-1] == "odds"
    assert len(texts) == len(places) + 1


def test_where_no_place_was_tried_the_refit_alone_is_shown(found: Any, tmp_path: Path) -> None:
    bare = replace(found, study=replace(found.study, trials=[]))
    assert figures.odds(bare, tmp_path / "places.png").stat().st_size > 5000


def test_what_would_dwarf_the_rest_is_left_out_and_said() -> None:
    axis = figures._drawn(1, 1, (4, 3))[1][0, 0]
    figures._left_over(axis, [0, 1], {"nominal": [0, -70.0], "refit": [0, 3.0], "amended": [0, 1.0]}, "V")
    assert [line.get_label() for line in axis.lines] == ["refit", "amended"]
    assert axis.get_title(loc="right") == "nominal not shown: it leaves up to 70 V"
