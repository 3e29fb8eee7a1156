"""What a sweep draws, what it makes of each run, and its figures: against scipy's distributions and closed forms."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats

import flexarm
from engine.errors import FlexarmError
from flexarm.plotting.sweeps import rank_correlation
from flexarm.sweeps.metrics import overshoot, rise_time, settling_time
from flexarm.sweeps.samples import Sample, correlated
from flexarm.sweeps.sweep import make_plan
from scenarios.load import load

SWING = """
schema: 1
name: swing
blocks:
  step: {type: Step, height: 1 rad}
  law: {type: TransferFunction, numerator: [100], denominator: [1, 6, 100]}
  gain: {type: Gain, gain: 2}
  wheel: {type: Inertia, inertia: 0.5 kg.m2}
  brake: {type: BearingFriction, viscous_friction: 0.1 N.m.s/rad}
connect:
  - [step.out, law.in]
  - [law.out, gain.in]
  - [wheel.shaft, brake.shaft]
initial: {wheel.shaft.speed: 2}
simulate: {stop: 4 s, step: 2 ms, record: [law.out, gain.out, wheel.shaft.speed]}
"""


@pytest.fixture
def swing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "swing.yaml"
    path.write_text(SWING)
    return path


LAWS: list[tuple[str, Any]] = [
    ("normal(10%)", scipy.stats.norm(0.5, 0.05)),
    ("normal(0.02 kg.m2)", scipy.stats.norm(0.5, 0.02)),
    ("normal(600000 g.m2, 0.1)", scipy.stats.norm(600.0, 0.1)),
    ("lognormal(20%)", scipy.stats.lognorm(math.sqrt(math.log(1.04)), scale=0.5)),
    ("lognormal(2 kg.m2, 5%)", scipy.stats.lognorm(math.sqrt(math.log(1.0025)), scale=2.0)),
    ("triangular(20%)", scipy.stats.triang(0.5, 0.4, 0.2)),
    ("triangular(0.3, 0.4, 0.9)", scipy.stats.triang(1 / 6, 0.3, 0.6)),
    ("uniform(1, 3)", scipy.stats.uniform(1, 2)),
    ("normal(0.1, 0.1)", scipy.stats.truncnorm(-1, math.inf, 0.1, 0.1)),
]


@pytest.mark.parametrize(("text", "law"), LAWS)
def test_laws_are_those_of_their_names(swing: Path, text: str, law: Any) -> None:
    """Quantiles of each law; one that reaches below the block's bound (an inertia is positive) is cut there."""
    (sample,) = make_plan(load(swing), [f"wheel.inertia~{text}"], runs=1).samples
    shares = np.linspace(0.001, 0.999, 41)
    found = [sample.at(float(share), 0.5) for share in shares]
    np.testing.assert_allclose(found, law.ppf(shares), rtol=1e-9)


POINTS = "points: 20 * $share, breakpoints: [0, 1]"


@pytest.mark.parametrize(
    ("old", "new", "left", "values"),
    [
        ("type: Gain, gain: 2", f"type: LookupTable, {POINTS}, heights: 1", "'gain.points'", "0.1"),
        ("shaft.speed: 2}", "shaft.speed: 20 * $share}", "the start of 'wheel.shaft.speed'", "0.1,0.2"),
    ],
)
def test_a_draw_that_would_change_half_of_what_it_gives(
    swing: Path, old: str, new: str, left: str, values: str
) -> None:
    """What shapes the model, or a start, keeps the value that it was built with: only an axis changes both."""
    text = SWING.replace("blocks:", "parameters: {share: 0.1}\nblocks:").replace(
        "friction: 0.1 N", "friction: $share * 1 N"
    )
    swing.write_text(text)
    make_plan(load(swing), ["share~10%"], runs=1)
    swing.write_text(text.replace(old, new))
    with pytest.raises(FlexarmError) as caught:
        make_plan(load(swing), ["share~10%"], runs=1)
    assert f"'share' gives {left} too, which a draw does not change" in str(caught.value)
    plan = make_plan(load(swing), [f"share={values}"])
    assert [axis.names for axis in plan.axes] == [()], "a model is built for each value"


def test_of_a_list_the_values_are_drawn_that_follow_no_parameter(swing: Path) -> None:
    table = "type: LookupTable, points: 3, breakpoints: [0, 1, 2], heights: [1, $share, 3]"
    swing.write_text(SWING.replace("blocks:", "parameters: {share: 2}\nblocks:").replace("type: Gain, gain: 2", table))
    drawn = make_plan(load(swing), ["gain.heights~10%"], runs=1).samples
    assert [sample.name for sample in drawn] == ["gain.heights[1]", "gain.heights[3]"]
    with pytest.raises(FlexarmError, match=r"'gain.heights\[2\]' follows share\n.*--vary 'share~10%'"):
        make_plan(load(swing), ["gain.heights[2]~10%"], runs=1)


def test_a_triangle_is_cut_at_a_bound() -> None:
    sample = Sample("x", 0.0, 1.0, "1", False, floor=0.2, ceiling=0.7, law="triangular", centre=0.4)
    whole = scipy.stats.triang(0.4, 0.0, 1.0)
    low, high = whole.cdf([0.2, 0.7])
    for share in (0.0, 0.3, 0.8, 1.0):
        assert sample.at(share, 1.0) == pytest.approx(whole.ppf(low + (high - low) * share), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gauss(10%)", "'gauss' is no law to draw by"),
        ("normal(1, 2, 3)", "normal takes 1 or 2 values, not 3"),
        ("normal(-0.1)", "is no standard deviation"),
        ("lognormal(0.5, 0.1)", "'0.1' is no share"),
        ("triangular(3, 2, 1)", "do not rise"),
        ("normal(3 m)", "unit 'm' does not fit"),
        ("12", "is no range to draw from"),
        ("normal(-5, 0.1)", "'normal(-5, 0.1)' gives no value that 'wheel.inertia' may have\n  it must be > 0 kg.m2"),
        ("lognormal(-5, 10%)", "gives no value that 'wheel.inertia' may have"),
        ("triangular(-3, -2, -1)", "gives no value that 'wheel.inertia' may have"),
        ("uniform(-3, -1)", "gives no value that 'wheel.inertia' may have"),
    ],
)
def test_laws_that_do_not_fit(swing: Path, text: str, message: str) -> None:
    with pytest.raises(FlexarmError) as caught:
        make_plan(load(swing), [f"wheel.inertia~{text}"], runs=1)
    assert message in str(caught.value)


def test_correlated_draws_have_their_correlation() -> None:
    wanted = np.array([[1.0, -0.8, 0.3], [-0.8, 1.0, 0.0], [0.3, 0.0, 1.0]])
    shares = np.random.default_rng(0).random((4000, 4))
    drawn = np.array([correlated(row, wanted.tolist()) for row in shares.tolist()])
    normal = scipy.stats.norm.ppf(drawn[:, :3])
    np.testing.assert_allclose(np.corrcoef(normal.T), wanted, atol=4 / math.sqrt(4000))
    np.testing.assert_array_equal(drawn[:, 3], shares[:, 3])
    for column in drawn.T:
        assert scipy.stats.kstest(column, "uniform").pvalue > 1e-4


def test_a_fit_is_drawn_as_it_left_things(swing: Path, command: Any) -> None:
    fit = {
        "parameters": {"wheel.inertia": {"value": 0.7}, "brake.viscous_friction": {"value": 0.2}},
        "spread": {
            "names": ["wheel.inertia", "brake.viscous_friction"],
            "logarithmic": [True, False],
            "deviation": [0.05, 0.01],
            "correlation": [[1.0, 0.9], [0.9, 1.0]],
        },
    }
    Path("fit.json").write_text(json.dumps(fit))
    answer = command("sweep", swing, "--from-fit", "fit.json", "--runs", 300, "-o", "out", "--workers", 1)
    assert answer.code == 0, answer.err
    table = flexarm.read("out/runs.parquet")
    inertia, friction = np.log(table["wheel.inertia"] / 0.7), table["brake.viscous_friction"]
    assert inertia.mean() == pytest.approx(0, abs=4 * 0.05 / math.sqrt(300))
    assert inertia.std() == pytest.approx(0.05, rel=0.2)
    assert friction.mean() == pytest.approx(0.2, abs=4 * 0.01 / math.sqrt(300))
    assert np.corrcoef(inertia, friction)[0, 1] == pytest.approx(0.9, abs=0.05)
    exact = 2 * np.exp(-4 * friction / table["wheel.inertia"])
    np.testing.assert_allclose(table["wheel.shaft.speed.final"], exact, rtol=1e-7)
    Path("other.json").write_text("{}")
    answer = command("sweep", swing, "--from-fit", "other.json", "--runs", 3, "-o", "out2")
    assert answer.code == 1
    assert "no result of a fit with its spread" in answer.err


def test_metrics_against_a_second_order_system(swing: Path, command: Any) -> None:
    """Overshoot exp(-pi zeta / sqrt(1 - zeta^2)); the envelope bounds the settling time; a Python function too."""
    Path("mine.py").write_text("def area(result):\n    return float(abs(result['law.out']).sum()) * 0.002\n")
    options = ["-m", "over=overshoot(law.out, target=1 rad)", "-m", "settling_time(law.out, target=1, band=2%)"]
    options += ["-m", "late=rms(wheel.shaft.speed, after=1 s)", "-m", "mine.py:area"]
    answer = command("sweep", swing, "-v", "gain.gain=1,3", "-o", "out", "--workers", 1, *options)
    assert answer.code == 0, answer.err
    table = flexarm.read("out/runs.parquet")
    w, decay = math.sqrt(100 - 9), 3.0
    np.testing.assert_allclose(table["over"], math.exp(-math.pi * decay / w), rtol=1e-3)
    t = np.arange(0, 4.0005, 0.002)
    y = 1 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    last = t[np.flatnonzero(abs(y - 1) > 0.02)[-1]]
    np.testing.assert_allclose(table["settling_time(law.out)"], last + 0.002, atol=1e-9)
    speed = 2 * np.exp(-0.2 * t[t >= 1])
    np.testing.assert_allclose(table["late"], math.sqrt(np.mean(speed**2)), rtol=1e-6)
    np.testing.assert_allclose(table["area"], abs(y).sum() * 0.002, rtol=1e-5)
    assert table.units["settling_time(law.out)"] == "s"
    assert "over: median" in answer.out


def test_metrics_of_lines() -> None:
    t = np.linspace(0, 10, 1001)
    ramp = np.minimum(t, 8.0)
    assert rise_time(t, ramp, 8.0) == pytest.approx(0.8 * 8)
    assert overshoot(t, ramp, 8.0) == 0.0
    assert overshoot(t, -ramp, -4.0) == pytest.approx(1.0)
    assert math.isnan(settling_time(t, t, 5.0))
    assert math.isnan(rise_time(t, ramp, 80.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("overshot(law.out)", "there is no metric 'overshot'"),
        ("overshoot(law.output)", "'law.output' is not among the outputs"),
        ("rms(law.out, band=2%)", "'band=2%' is no setting of rms"),
        ("none.py:f", "there is no file 'none.py'"),
        ("law.out", "'law.out' is no metric"),
        ("rms(law.out, after=1 V)", "--metric rms(law.out, after=1 V): '1 V': unit 'V' does not fit"),
        ("run=rms(law.out)", "--metric run=rms(law.out): the table has a column 'run' already"),
        ("failure=rms(law.out)", "the table has a column 'failure' already"),
        ("bias=rms(law.out)", "the table has a column 'bias' already"),
    ],
)
def test_metrics_that_do_not_fit(swing: Path, text: str, message: str) -> None:
    shared = swing.with_name("shared.yaml")
    shared.write_text(SWING.replace("blocks:", "parameters: {bias: 2}\nblocks:").replace("gain: 2}", "gain: $bias}"))
    with pytest.raises(FlexarmError) as caught:
        make_plan(load(shared), ["bias=1,2"], metrics=[text])
    assert message in str(caught.value)


def test_figures_of_too_few_runs(swing: Path, command: Any) -> None:
    """The table is whole, and the sweep said after all runs that no value was varied."""
    answer = command("sweep", swing, "-v", "wheel.inertia=1,2,3", "-o", "out", "--workers", 1, "--figures")
    assert answer.code == 0, answer.err
    assert "figures need 5 runs with a number, and 3 of 3 have one" in answer.err
    assert "written: out/runs.parquet" in answer.out
    answer = command("sweep", swing, "-v", "wheel.inertia=1", "-o", "one", "--workers", 1, "--figures")
    assert "no number was varied" in answer.err


def test_figures_of_a_monte_carlo(swing: Path, command: Any) -> None:
    options = ["-v", "wheel.inertia~20%", "-v", "brake.viscous_friction~20%", "-v", "gain.gain~10%", "-n", 60]
    answer = command(
        "sweep", swing, *options, "-o", "out", "--workers", 1, "-m", "last=mean(wheel.shaft.speed)", "--figures"
    )
    assert answer.code == 0, answer.err
    for name in ("tornado.png", "scatter.png"):
        assert Path("out", name).stat().st_size > 5000
    table = flexarm.read("out/runs.parquet")
    last = table["last"]
    assert rank_correlation(table["wheel.inertia"], last) > 0.5
    assert rank_correlation(table["brake.viscous_friction"], last) < -0.5
    assert rank_correlation(table["gain.gain"], last) == pytest.approx(
        scipy.stats.spearmanr(table["gain.gain"], last).statistic
    )
