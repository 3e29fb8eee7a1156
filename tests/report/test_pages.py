"""What reports hold: curves that lose no peak, data that cannot end its element, hashes that can be checked."""

from __future__ import annotations

import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexarm
from diagnosis.api import gather
from diagnosis.estimation.least_squares import Fit
from diagnosis.problems import problem
from diagnosis.recordings.mapping import from_scenario
from diagnosis.recordings.types import FrequencyTable
from diagnosis.search.force_recovery import Curve
from engine.errors import FlexarmError
from flexarm.report.diagnosis_page import heading
from flexarm.report.evidence import evidence_charts
from flexarm.report.held_out import before_after
from flexarm.report.page import difference, render, significant, view_of, write_page
from flexarm.report.run_page import page, write_run
from flexarm.report.series import BUDGET, LEAST, Chart, Panel, Trace, as_json, fitting, thin
from scenarios.load import load
from tests.report.conftest import HOSTILE, axes


def _chart(key: Any, *views: Any) -> Chart:
    return Chart(key, key, "time", "s", views)


def _view(name: Any, count: Any, curves: Any) -> tuple[Any, tuple[Panel]]:
    t = np.linspace(0, 1, count)
    return name, (Panel("y", "V", tuple(Trace(f"c{i}", t, np.sin(40 * t + i)) for i in range(curves))),)


def test_thinning_keeps_every_peak() -> None:
    t = np.linspace(0, 1, 100_000)
    y = 0.1 * np.sin(20 * t)
    y[12_345], y[77_777] = 9.0, -7.0
    made = thin(Trace("y", t, y), 2000)
    assert len(np.asarray(made.y)) <= 2002
    assert np.max(made.y) == 9.0
    assert np.min(made.y) == -7.0
    assert np.asarray(made.x)[np.argmax(made.y)] == t[12_345]
    assert (np.diff(np.asarray(made.x)) > 0).all()


def test_thinning_leaves_short_curves_and_gaps() -> None:
    short = Trace("y", np.arange(10), np.arange(10.0))
    assert thin(short, 100) is short
    y = np.where(np.arange(5000) < 2500, np.nan, 1.0)
    made = thin(Trace("y", np.arange(5000), y), 500)
    assert np.isnan(np.asarray(made.y)[:100]).all()
    assert np.nanmax(made.y) == 1.0


def test_a_page_keeps_to_its_budget_and_says_so() -> None:
    many = [_view(f"recording {i}", 50_000, 8) for i in range(200)]
    (made,) = fitting([_chart("a", *many)])
    numbers = sum(2 * np.size(t.y) for _, panels in made.views for p in panels for t in p.traces)
    assert numbers <= 1.1 * BUDGET
    assert len(as_json([made])) < 3e6
    assert any("50000 points" in note for note in made.notes)
    assert any("recording 199" in note for note in made.notes)
    assert all(np.size(t.y) >= LEAST for _, panels in made.views for p in panels for t in p.traces)


def test_data_cannot_end_its_element() -> None:
    chart = Chart(
        "a", "t", "x", "s", (("</script><script>", (Panel("<!--", "&", (Trace("]]>", [0, 1], [1, np.nan]),)),)),)
    )
    text = as_json([chart])
    assert not set("<>&") & set(text)
    assert json.loads(text)[0]["views"][0]["name"] == "</script><script>"
    assert json.loads(text)[0]["views"][0]["panels"][0]["traces"][0]["y"] == [1.0, None]


def test_numbers_and_differences_read_well() -> None:
    assert significant(-1.23456e-7) == "−1.235e−7"
    assert significant(14098.5) == "1.41e+4"
    rows = difference("a\nb\nc\n", "a\nB\nc\n")
    assert [(r.kind, r.sign, r.text) for r in rows[1:]] == [
        ("same", " ", "a"),
        ("removed", "−", "b"),
        ("added", "+", "B"),
        ("same", " ", "c"),
    ]


class _Outline(HTMLParser):
    """Headings in order, ids, labels, and addresses that a page would fetch."""

    def __init__(self, text: Any) -> None:
        super().__init__()
        self.headings: list[Any] = []
        self.ids: list[Any] = []
        self.named: list[Any] = []
        self.fetched: list[Any] = []
        self.tags: list[Any] = []
        self.feed(text)

    def handle_starttag(self, tag: Any, attrs: Any) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if "id" in given:
            self.ids.append(given["id"])
        self.named += (given.get("aria-labelledby") or "").split()
        self.fetched += [given[k] for k in ("src", "href", "srcset", "data") if given.get(k)]


def check_outline(text: Any) -> Any:
    """Headings step down by one, ids are unique and every name refers to one, nothing would be fetched."""
    found = _Outline(text)
    assert found.headings[0] == 1
    assert found.headings.count(1) == 1
    assert all(b - a <= 1 for a, b in zip(found.headings, found.headings[1:], strict=False))
    assert len(set(found.ids)) == len(found.ids)
    assert set(found.named) <= set(found.ids)
    assert all(address.startswith(("#", "data:")) for address in found.fetched)
    assert found.tags.count("script") == 2
    assert "@import" not in text
    assert "url(" not in text
    return found


def test_a_run_is_reported_with_what_repeats_it(tmp_path: Path) -> None:
    scenario = load(axes(tmp_path, 1), ["load0.inertia=0.02 kg.m2"])
    text = page(scenario, flexarm.simulate(scenario), command="flexarm run axes.yaml")
    check_outline(text)
    assert "&lt;script&gt;document" in text
    assert HOSTILE not in text
    for file in (tmp_path / "axes.yaml", tmp_path / "axis.yaml"):
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    assert "load0.inertia=0.02 kg.m2" in text
    assert "flexarm run axes.yaml" in text
    assert "axis0.friction" in text


def _data(text: str) -> Any:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text)
    assert found
    return json.loads(found[1])


def test_the_energy_of_a_run_is_in_its_report() -> None:
    scenario = load("quanser-single-link")
    text = page(scenario, flexarm.simulate(scenario, stop=0.5))
    data = _data(text)
    energy = next(c for c in data if c["key"] == "energy")["views"][0]["panels"]
    stored, supplied, dissipated = (np.array(t["y"]) for t in energy[0]["traces"])
    assert supplied[-1] > 0
    assert np.allclose(stored + dissipated - supplied, stored[0], atol=1e-5 * supplied[-1])


def test_curves_in_the_page_are_those_of_the_run() -> None:
    scenario = load("quanser-single-link")
    result = flexarm.simulate(scenario, stop=0.3)
    text = page(scenario, result)
    data = _data(text)
    traces = {t["name"]: t for p in data[0]["views"][0]["panels"] for t in p["traces"]}
    assert set(traces) == set(result.names)
    for name in result.names:
        assert np.allclose(traces[name]["y"], result[name], rtol=1e-5, atol=1e-30)
        assert traces[name]["dt"] == pytest.approx(1e-3)


def test_a_page_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(FlexarmError, match="html"):
        write_page(tmp_path / "a.txt", "x")
    scenario = load("srv02-bare")
    result = flexarm.simulate(scenario, stop=0.1)
    assert write_run(scenario, result, tmp_path / "a.html").is_file()
    assert [p.name for p in tmp_path.iterdir()] == ["a.html"]


def test_evidence_is_drawn_where_there_is_some() -> None:
    assert evidence_charts(()) == []
    x = np.array([2.0, 1.0, 3.0])
    curve = Curve("torque against u", "u", "V", "torque", "N.m", x, 10 * x, 9 * x, 11 * x, 0.9, (1.0, 3.0))
    (chart,) = evidence_charts((curve,))
    ((_, (panel,)),) = chart.views
    (trace,) = panel.traces
    for drawn, times in ((trace.x, 1), (trace.y, 10), (trace.low, 9), (trace.high, 11)):
        assert np.asarray(drawn).tolist() == [1.0 * times, 2.0 * times, 3.0 * times]
    assert (chart.title, chart.x_label, chart.x_unit) == ("torque against u", "u", "V")
    assert (panel.label, panel.unit) == ("torque", "N.m")


def test_every_value_of_a_template_is_escaped() -> None:
    text = render("run.html.j2", [_chart("outputs", _view("", 5, 1))], **_values(title="</title>" + HOSTILE))
    assert HOSTILE not in text


def _values(**given: Any) -> Any:
    scenario = load("srv02-bare")
    result = flexarm.simulate(scenario, stop=0.1)
    from flexarm.plotting.wiring.diagram import diagram
    from flexarm.report.origin import origin

    values = {
        "title": "t",
        "scenario": scenario,
        "result": result,
        "picture": diagram(scenario),
        "signals": [],
        "energy": False,
        "no_energy": HOSTILE,
        "events": [(0.1, HOSTILE, HOSTILE)],
        "parameters": [(HOSTILE, 1.0, HOSTILE)],
        "origin": origin(scenario, command=HOSTILE),
    }
    return values | given


def test_a_table_is_drawn_over_its_frequencies() -> None:
    scenario = load("srv02-bare")
    made = problem(scenario, gather(scenario, (), ()))
    count = len(made.free)
    fit = Fit(made, np.zeros(count), 0.0, 0.0, True, np.zeros((count, count)))
    study = SimpleNamespace(
        refit=SimpleNamespace(fit=fit, hold_out=1.0), chosen=SimpleNamespace(fit=fit, effects=(1,)), nominal=(1.0, 1.0)
    )
    chart = before_after(SimpleNamespace(study=study))  # type: ignore[arg-type]
    assert (chart.log, chart.x_label, chart.x_unit) == (True, "frequency", "rad/s")
    ((_, (above, below)),) = chart.views
    table = from_scenario(scenario, "table_2_2")
    assert isinstance(table, FrequencyTable)
    points = [t for t in above.traces if t.points]
    drawn = np.concatenate([np.column_stack([t.x, t.y]) for t in points])
    (response,) = table.responses
    expected = np.column_stack([table.frequency, 20 * np.log10(response.values / table.amplitude)])
    assert np.allclose(drawn[np.argsort(drawn[:, 0])], expected[np.argsort(expected[:, 0])], rtol=1e-9)
    # The comparison of one row with another simulation of it: `flexarm compare`.
    (signal,) = flexarm.compare(scenario, "table_2_2").signals.values()
    simulated = 20 * np.log10(np.asarray(signal.simulated) / table.amplitude)
    curve = next(t for t in above.traces if t.name == "refitted")
    assert np.allclose(np.sort(curve.y), np.sort(simulated), atol=0.02)
    assert below.unit == "dB"


def _finding(status: str) -> dict[str, str]:
    return {"status": status}


@pytest.mark.parametrize(
    ("verdict", "statuses", "effects", "title"),
    [
        ("named", ["named"], 1, "The missing effect is named"),
        ("named", ["named", "named"], 2, "The missing effects are named"),
        ("unknown", ["unknown"], 0, "Something is missing that has no name here"),
        ("unknown", ["unknown"], 1, "no name is sure"),
        ("unknown", ["named", "unknown"], 2, "A missing effect is named; more is missing"),
        ("tie", ["named", "tie"], 2, "A missing effect is named; of another several explain"),
        ("wrong_parameter", ["named", "wrong_parameter"], 2, "An effect is missing, and a parameter is wrong"),
        ("none", ["none"], 0, "Nothing is missing"),
    ],
)
def test_the_title_fits_all_findings(verdict: str, statuses: list[str], effects: int, title: str) -> None:
    chosen = SimpleNamespace(effects=("effect",) * effects)
    found: Any = SimpleNamespace(
        verdict=verdict, findings=[_finding(s) for s in statuses], study=SimpleNamespace(chosen=chosen)
    )
    assert title in heading(found)


def test_a_band_is_no_wider_than_what_it_shows() -> None:
    x = np.linspace(0.0, 1.0, 5)
    wide = np.array([0.1, 0.1, 0.1, 50.0, 900.0])
    (chart,) = evidence_charts([Curve("t", "x", "1", "y", "N", x, x, x - wide, x + wide, 0.5, (0.0, 1.0))])
    trace = chart.views[0][1][0].traces[0]
    assert np.max(np.asarray(trace.high)) == 2.0
    assert np.min(np.asarray(trace.low)) == -1.0
    assert "cut" in chart.notes[0]


def test_a_warning_leads_to_its_recording() -> None:
    chart = _chart("a", _view("one (fitted)", 5, 1), _view("two (held out)", 5, 1))
    assert view_of("'x' of recording 'two' jumps", chart) == "two (held out)"
    assert view_of("recording 'three': late", chart) == ""
