"""``flexarm sweep``: rows against closed forms and single runs, resuming, refusals, the same bytes always."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexarm
from engine.errors import FlexarmError
from flexarm.sweeps.sweep import make_plan
from flexarm.sweeps.work import compute
from scenarios.load import load

SPIN = """\
schema: 1
name: spin
parameters: {push: 2 N.m}
blocks:
  source: {type: Step, height: $push}
  torque: {type: Torque}
  wheel: {type: Inertia, inertia: 0.5 kg.m2}
  law: {type: BearingFriction, viscous_friction: 0}
connect:
  - [source.out, torque.torque]
  - [torque.shaft, wheel.shaft]
  - [wheel.shaft, law.shaft]
simulate: {stop: 1 s, step: 10 ms, record: [wheel.shaft.speed, wheel.shaft.angle]}
"""


@pytest.fixture
def spin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "spin.yaml"
    path.write_text(SPIN)
    return path


def test_grid_against_newton(spin: Path, command: Any) -> None:
    """Constant torque T on inertia J: speed T t / J, angle T t^2 / 2J; its mean square over [0, 1] is (T/2J)^2 / 5."""
    answer = command(
        "sweep", spin, "-v", "wheel.inertia=0.5:2:4", "-v", "push=1 N.m,3 N.m", "-o", "out", "--workers", 1
    )
    assert answer.code == 0, answer.err
    table = flexarm.read("out/runs.parquet")
    inertia, push = (values.ravel() for values in np.meshgrid([0.5, 1.0, 1.5, 2.0], [1.0, 3.0], indexing="ij"))
    assert table["run"].tolist() == list(range(8))
    assert table["wheel.inertia"].tolist() == inertia.tolist()
    assert table["push"].tolist() == push.tolist()
    assert table["wheel.shaft.speed.final"] == pytest.approx(push / inertia, rel=1e-12)
    assert table["wheel.shaft.angle.max"] == pytest.approx(push / inertia / 2, rel=1e-12)
    assert table["wheel.shaft.angle.min"].tolist() == [0.0] * 8
    rows = (np.arange(101) / 100) ** 2
    assert table["wheel.shaft.angle.rms"] == pytest.approx(push / inertia / 2 * math.sqrt(np.mean(rows**2)), rel=1e-12)
    assert table.units["wheel.inertia"] == "kg.m2"
    assert table.units["wheel.shaft.speed.rms"] == "rad/s"
    assert table.scenario_hash == load(spin).digest
    assert not Path("out/runs.parquet.parts").exists()
    assert [path.name for path in Path("out").iterdir()] == ["runs.parquet"]


def test_rows_are_those_of_single_runs(base: Path) -> None:
    """Parameters, an option, a value of zero and a time: each row is `flexarm run` with the same --set."""
    done = flexarm.sweep(
        base, ["gear.ratio=14,70", "simulate.stop=50 ms,0.1 s", "motor.viscous_friction=0,1e-6"], "out", workers=1
    )
    table = flexarm.read(done.table)
    assert len(table) == 8
    assert table.units["simulate.stop"] == "s"
    for i in range(8):
        texts = [f"{key}={table[key][i].item()!r}" for key in ("gear.ratio", "simulate.stop", "motor.viscous_friction")]
        result = flexarm.simulate(load(base, texts))
        assert table["load.shaft.angle.final"][i] == result["load.shaft.angle"][-1]
        assert table["zone.out.rms"][i] == math.sqrt(np.mean(result["zone.out"] ** 2))


def test_what_needs_a_model_of_its_own_varies_slowest(spin: Path) -> None:
    plan = make_plan(load(spin), ["wheel.inertia=1:2:3", "simulate.step=1 ms,10 ms", "push=1:2:2"])
    assert [axis.key for axis in plan.axes] == ["simulate.step", "wheel.inertia", "push"]
    assert [bool(axis.names) for axis in plan.axes] == [False, True, True]
    assert len({plan.run(k).structure for k in range(6)}) == 1
    assert plan.total == 12


def test_options_and_counts(spin: Path) -> None:
    """Whole numbers stay whole in a range, texts are kept as texts."""
    done = flexarm.sweep("quanser-single-link", ["link.modes=1:3:3"], "modes", stop=0.05, workers=1)
    table = flexarm.read(done.table)
    assert table["link.modes"].tolist() == [1, 2, 3]
    finals = table["link.tip.deflection.final"]
    assert len(set(finals.tolist())) == 3
    for modes, final in zip((1, 2, 3), finals, strict=True):
        assert (
            final
            == flexarm.simulate(load("quanser-single-link", [f"link.modes={modes}"]), 0.05)["link.tip.deflection"][-1]
        )


def test_draws_lie_in_their_intervals_and_are_uniform(spin: Path) -> None:
    """400 draws of a uniform value: mean within 4 standard errors (width / sqrt(12 n)), both ends are approached."""
    done = flexarm.sweep(
        spin, ["wheel.inertia~20%", "push~1:3", "law.viscous_friction=0,0.1"], "mc", runs=400, workers=1
    )
    table = flexarm.read(done.table)
    assert len(table) == 800
    for name, low, high in (("wheel.inertia", 0.4, 0.6), ("push", 1.0, 3.0)):
        values = table[name][:400]
        assert ((values > low) & (values < high)).all()
        assert abs(values.mean() - (low + high) / 2) < 4 * (high - low) / math.sqrt(12 * 400)
        assert values.min() < low + 0.02 * (high - low)
        assert values.max() > high - 0.02 * (high - low)
        assert (table[name][400:] == values).all(), "each point of the grid draws the same"
    assert abs(np.corrcoef(table["wheel.inertia"][:400], table["push"][:400])[0, 1]) < 0.2
    expected = table["push"][:400] / table["wheel.inertia"][:400]
    assert table["wheel.shaft.speed.final"][:400] == pytest.approx(expected, rel=1e-12)
    other = flexarm.sweep(spin, ["wheel.inertia~20%"], "other", runs=3, seed=1, workers=1)
    assert not set(flexarm.read(other.table)["wheel.inertia"]) & set(table["wheel.inertia"])


def test_declared_tolerances_by_pattern() -> None:
    scenario = load("quanser-single-link")
    model = scenario.build()
    plan = make_plan(scenario, ["*~tolerance"], runs=5)
    declared = {p.name: p.declared.tolerance for p in model.parameters if p.declared.tolerance and p.value}
    assert {s.name: s.high - 1 for s in plan.samples} == pytest.approx(declared)


def test_tolerances_of_the_scenario_come_first(spin: Path) -> None:
    """A stated share in place of the library's, and 0 for what is known."""
    spin.write_text(SPIN + "tolerances: {wheel.inertia: 0.02, push: 0}\n")
    plan = make_plan(load(spin), ["*~tolerance"], runs=5)
    assert [(s.name, s.low, s.high) for s in plan.samples] == [("wheel.inertia", 0.98, 1.02)]
    with pytest.raises(FlexarmError, match="'push' has no tolerance"):
        make_plan(load(spin), ["push~tolerance"], runs=5)


def test_a_tolerance_of_what_is_no_parameter_is_refused(spin: Path, command: Any) -> None:
    """It drew within the library's tolerance instead; `check` found nothing."""
    spin.write_text(SPIN + "tolerances: {wheel.inertja: 0.02}\n")
    with pytest.raises(FlexarmError, match=r"tolerances.wheel.inertja: .*\n  did you mean 'wheel.inertia'"):
        make_plan(load(spin), ["*~tolerance"], runs=5)
    answer = command("check", spin)
    assert answer.code == 1
    assert "did you mean 'wheel.inertia'?" in answer.err


def test_bounds_cut_an_interval(spin: Path) -> None:
    """An efficiency of 0.9 with 20 % would reach 1.08, and 1 is the most."""
    done = flexarm.sweep(
        "quanser-single-link", ["gear.efficiency~20%"], "cut", runs=60, stop=0.01, outputs=["link.hub.angle"], workers=1
    )
    values = flexarm.read(done.table)["gear.efficiency"]
    assert values.max() <= 1.0
    assert values.min() >= 0.72
    assert values.max() > 0.99


def test_trajectories(spin: Path) -> None:
    """Speed T t / J every 100 ms of every run."""
    flexarm.sweep(spin, ["wheel.inertia=1,2,4"], "out", keep=0.1, workers=1)
    table = flexarm.read("out/trajectories.parquet")
    assert table.names == ["run", "time", "wheel.shaft.speed", "wheel.shaft.angle"]
    assert table.units["time"] == "s"
    assert table["run"].tolist() == [k for k in range(3) for _ in range(11)]
    inertia = np.array([1.0, 2.0, 4.0])[table["run"]]
    assert table["time"][:11] == pytest.approx(np.arange(11) / 10)
    assert table["wheel.shaft.speed"] == pytest.approx(2 * table["time"] / inertia, rel=1e-12)


def test_failures_are_rows(spin: Path) -> None:
    """A strong damper at a long internal step diverges (RK4 needs h b / J < 2.78); the run after it does not."""
    spin.write_text(SPIN.replace("step: 10 ms", "step: 10 ms, internal_step: 10 ms"))
    done = flexarm.sweep(spin, ["law.viscous_friction=0,1e4,1"], "out", workers=1)
    table = flexarm.read(done.table)
    assert table["failure"][0] is None
    assert "diverged" in table["failure"][1]
    assert math.isnan(table["wheel.shaft.speed.final"][1])
    # J w' = T - b w: w = T/b (1 - exp(-b t / J)); RK4 at 10 ms is good to 1e-9 here.
    assert table["wheel.shaft.speed.final"][2] == pytest.approx(2 * (1 - math.exp(-2)), rel=1e-8)


def test_a_sweep_of_which_every_run_fails_has_failed(spin: Path, command: Any) -> None:
    """The signals are written all the same; a metric that works for no run is no success."""
    (spin.parent / "own.py").write_text("def many(result):\n    return [1.0, 2.0]\n")
    asked = ["--vary", "wheel.inertia=1,2", "--metric", "b=own.py:many"]
    answer = command("sweep", spin, *asked, "-o", "out", "--workers", 1)
    assert answer.code == 1
    assert "every run failed; the first: metric own.py:many" in answer.err
    assert np.isfinite(flexarm.read("out/runs.parquet")["wheel.shaft.speed.final"]).all()


@pytest.mark.slow
def test_the_same_bytes_whatever_does_the_work(spin: Path, cluster: str, command: Any) -> None:
    """One process, two processes, a cluster, other threads and hash seeds: files equal byte for byte."""
    asked = ["sweep", "spin.yaml", "-v", "wheel.inertia=1:2:3", "-v", "simulate.step=5 ms,10 ms", "-v", "push~10%"]
    asked += ["-n", "40", "--keep", "50 ms"]
    for name, extra in {"one": ("--workers", "1"), "two": ("--workers", "2"), "dask": ("--scheduler", cluster)}.items():
        answer = command(*asked, "-o", name, *extra)
        assert answer.code == 0, answer.err
    for k, seed in enumerate(("1", "2")):
        environment = os.environ | {"PYTHONHASHSEED": seed, "OMP_NUM_THREADS": str(k + 1)}
        run = [sys.executable, "-m", "flexarm", *asked, "-o", f"hash{seed}", "--workers", "1"]
        subprocess.run(run, check=True, env=environment, capture_output=True, timeout=600)
    for file in ("runs.parquet", "trajectories.parquet"):
        wanted = Path("one", file).read_bytes()
        for name in ("two", "dask", "hash1", "hash2"):
            assert Path(name, file).read_bytes() == wanted, f"{name}/{file}"


def test_a_cluster_that_does_not_answer(spin: Path, command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.spread.CONNECT", "0.5s")
    answer = command("sweep", spin, "-v", "push=1,2", "-o", "out", "--scheduler", "tcp://127.0.0.1:9")
    assert answer.code == 1
    assert "no dask scheduler answers at 'tcp://127.0.0.1:9'" in answer.err


def test_workers_elsewhere_are_sent_the_files(tmp_path: Path) -> None:
    """The scenario, a sub-assembly and a table, gone from this disk before the work begins."""
    from flexarm.sweeps.work import compute
    from scenarios.files import packed

    place = tmp_path / "place"
    (place / "parts").mkdir(parents=True)
    (place / "parts" / "wheel.yaml").write_text(
        "schema: 1\nname: wheel\nblocks:\n  rim: {type: Inertia, inertia: 0.5}\n"
        "  torque: {type: Torque}\n  t: {type: Table, file: u.csv, column: u, scale: 1 N.m}\n"
        "connect:\n  - [t.out, torque.torque]\n  - [torque.shaft, rim.shaft]\n"
    )
    (place / "parts" / "u.csv").write_text("time,u\n0,3\n1,3\n")
    (place / "main.yaml").write_text(
        "schema: 1\nname: main\nblocks:\n  w: {type: ./parts/wheel.yaml}\n"
        "simulate: {stop: 1 s, step: 10 ms, record: [w.rim.shaft.speed]}\n"
    )
    scenario = load(place / "main.yaml")
    plan = replace(make_plan(scenario, ["w.rim.inertia=0.5,1.5"]), files=packed(scenario))
    shutil.rmtree(place)
    rows = compute(plan, (0, 2)).columns
    assert rows["failure"] == [None, None]
    assert rows["w.rim.shaft.speed.final"] == pytest.approx([6.0, 2.0], rel=1e-12)


def test_resuming_computes_what_is_missing(spin: Path) -> None:
    vary = ["wheel.inertia=1:2:1000"]
    whole = flexarm.sweep(spin, vary, "whole.parquet", workers=1)
    assert whole.computed == 1000
    seen = 0

    def stop(done: int, total: int) -> None:
        nonlocal seen
        seen = done
        if done >= 300:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flexarm.sweep(spin, vary, "cut.parquet", workers=1, progress=stop)
    parts = Path("cut.parquet.parts")
    assert seen == 300
    manifest = json.loads((parts / "plan.json").read_text())
    assert manifest["plan_hash"] == whole.plan.hash
    assert not Path("cut.parquet").exists()
    (parts / ".runs-000000000-left.parquet").write_bytes(b"PAR1 half a file")
    done = flexarm.sweep(spin, vary, "cut.parquet", workers=1)
    assert done.computed == 700
    assert Path("cut.parquet").read_bytes() == Path("whole.parquet").read_bytes()
    assert not parts.exists()
    assert flexarm.sweep(spin, vary, "cut.parquet", workers=1).computed == 0


def test_another_plan_is_refused(spin: Path, command: Any) -> None:
    assert command("sweep", spin, "-v", "push=1,2", "-o", "out", "--workers", 1).code == 0
    answer = command("sweep", spin, "-v", "push=1,3", "-o", "out", "--workers", 1)
    assert answer.code == 1
    assert "is of another sweep: since then --vary changed" in answer.err
    assert "--restart" in answer.err
    spin.write_text(SPIN.replace("0.5 kg.m2", "0.6 kg.m2"))
    answer = command("sweep", spin, "-v", "push=1,2", "-o", "out", "--workers", 1)
    assert "since then the scenario or a file that its blocks read changed" in answer.err
    assert command("sweep", spin, "-v", "push=1,2", "-o", "out", "--workers", 1, "--restart").code == 0
    assert flexarm.read("out/runs.parquet")["wheel.shaft.speed.final"] == pytest.approx([1 / 0.6, 2 / 0.6])
    Path("foreign.parquet").write_bytes(b"not a table")
    answer = command("sweep", spin, "-v", "push=1,2", "-o", "foreign.parquet")
    assert "is no table of this sweep" in answer.err
    assert Path("foreign.parquet").read_bytes() == b"not a table"


def test_the_first_failure_is_told_at_once(spin: Path) -> None:
    """Before the runs after it are done, and only once."""
    Path("own.py").write_text("def late(result):\n    return result['nothing'][0]\n")
    said: list[tuple[int, str]] = []
    done = [0]

    def progress(so_far: int, total: int) -> None:
        done[0] = so_far

    flexarm.sweep(
        spin,
        ["push=1:2:10"],
        "out.parquet",
        workers=1,
        metrics=["own.py:late"],
        progress=progress,
        warn=lambda text: said.append((done[0], text)),
    )
    assert [at for at, _ in said] == [0]
    assert said[0][1].startswith("run 0 failed: metric own.py:late: ")


def test_two_at_once_are_refused(spin: Path) -> None:
    from flexarm.sweeps.store import SweepStore

    first = SweepStore(Path("out.parquet"), make_plan(load(spin), ["push=1,2"]), {})
    first.begin()
    with pytest.raises(FlexarmError, match=r"another process is at work on 'out\.parquet'"):
        flexarm.sweep(spin, ["push=1,2"], "out.parquet", workers=1)
    first.close()
    assert flexarm.sweep(spin, ["push=1,2"], "out.parquet", workers=1).computed == 2


def _half(spin: Path, keep: float | None = None) -> Path:
    """The parts of a sweep of eight runs, all there but the table."""
    from flexarm.sweeps.store import SweepStore

    plan = make_plan(load(spin), ["push=1:8:8"], keep=keep)
    Path("out").mkdir(exist_ok=True)
    store = SweepStore(Path("out/runs.parquet") if keep else Path("out.parquet"), plan, {})
    for span in store.begin():
        store.write(span, compute(plan, span))
    store.close()
    return store.parts


def test_restart_respects_a_sweep_that_runs(spin: Path) -> None:
    from flexarm.sweeps.store import SweepStore

    parts = _half(spin)
    first = SweepStore(Path("out.parquet"), make_plan(load(spin), ["push=1:8:8"]), {})
    first.begin()
    before = sorted(path.name for path in parts.iterdir())
    with pytest.raises(FlexarmError, match="another process is at work"):
        flexarm.sweep(spin, ["push=1,2"], "out.parquet", workers=1, restart=True)
    assert sorted(path.name for path in parts.iterdir()) == before
    first.close()
    assert flexarm.sweep(spin, ["push=1,2"], "out.parquet", workers=1, restart=True).computed == 2
    assert not parts.exists()


@pytest.mark.parametrize("damage", ["empty", "half", "tail", "byte", "text", "trajectories"])
def test_a_damaged_part_is_computed_again(spin: Path, damage: str) -> None:
    keep = 0.1 if damage == "trajectories" else None
    parts = _half(spin, keep)
    victim = sorted(parts.glob(f"{'trajectories' if keep else 'runs'}-*.parquet"))[3]
    content = victim.read_bytes()
    middle = len(content) // 3
    changed = {
        "empty": b"",
        "half": content[: len(content) // 2],
        "tail": content[:-1],
        "byte": content[:40] + bytes([content[40] ^ 255]) + content[41:],
        "text": b"nothing",
        "trajectories": content[:middle],
    }[damage]
    victim.write_bytes(changed)
    output = "out" if keep else "out.parquet"
    made = flexarm.sweep(spin, ["push=1:8:8"], output, workers=1, keep=keep)
    assert made.computed == 1
    assert flexarm.read(made.table)["wheel.shaft.speed.final"] == pytest.approx(
        [2.0 * k for k in range(1, 9)], rel=1e-12
    )


@pytest.mark.parametrize(
    "text", [b"", b"{", b"[1]", b"null", b"\xff\xfe", b'{"plan_hash": 3, "plan": 7}', b"[" * 100_000]
)
def test_a_broken_plan_is_refused_in_words(spin: Path, command: Any, text: bytes) -> None:
    parts = _half(spin)
    (parts / "plan.json").write_bytes(text)
    answer = command("sweep", spin, "-v", "push=1:8:8", "-o", "out.parquet", "--workers", 1)
    assert answer.code == 1
    assert "is no table of this sweep" in answer.err
    assert "--restart" in answer.err
    answer = command("sweep", spin, "-v", "push=1:8:8", "-o", "out.parquet", "--workers", 1, "--restart")
    assert answer.code == 0, answer.err


@pytest.mark.parametrize("place", ["parts", "lock", "plan"])
def test_what_stands_in_the_way_is_named(spin: Path, command: Any, place: str) -> None:
    parts = Path("out.parquet.parts")
    if place == "parts":
        parts.write_text("a file")
    else:
        (parts / {"lock": ".lock", "plan": "plan.json"}[place]).mkdir(parents=True)
    answer = command("sweep", spin, "-v", "push=1:8:8", "-o", "out.parquet", "--workers", 1)
    assert answer.code == 1
    assert "out.parquet.parts" in answer.err


def test_a_disk_that_fills_while_joining_costs_no_run(
    spin: Path, command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow.parquet

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(pyarrow.parquet.ParquetWriter, "write_table", full)
        answer = command("sweep", spin, "-v", "push=1:8:8", "-o", "out.parquet", "--workers", 1)
    # write_table of a part goes through the same writer, so the first part is refused already
    assert answer.code == 1
    assert "No space left" in answer.err
    _half(spin)
    with monkeypatch.context() as patch:
        patch.setattr(pyarrow.parquet.ParquetWriter, "write_table", full)
        answer = command("sweep", spin, "-v", "push=1:8:8", "-o", "out.parquet", "--workers", 1)
    assert answer.code == 1
    assert "goes on from here" in answer.err
    assert not Path("out.parquet").exists()
    assert not list(Path("out.parquet.parts").glob(".joined*"))
    assert flexarm.sweep(spin, ["push=1:8:8"], "out.parquet", workers=1).computed == 0


def test_workers_beyond_reason_are_refused(spin: Path, command: Any) -> None:
    answer = command("sweep", spin, "-v", "push=1:8:8", "-o", "out.parquet", "--workers", 100000)
    assert answer.code == 1
    assert "100000 workers are too many" in answer.err


def test_ctrl_c_and_go_on(spin: Path) -> None:
    """SIGINT to the whole group, as a terminal sends it: exit code 130, no process left, and the rest is done after."""
    run = [sys.executable, "-m", "flexarm", "sweep", "spin.yaml", "-v", "wheel.inertia=1:2:20000", "-o", "out"]
    run += ["--workers", "2"]
    process = subprocess.Popen(run, stderr=subprocess.PIPE, text=True, start_new_session=True)
    parts = Path("out/runs.parquet.parts")
    deadline = time.monotonic() + 600
    while len(list(parts.glob("runs-*.parquet"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=600)[1]
    assert process.returncode == 130, said
    assert re.search(r"interrupted after \d+ of 20000 runs; the same command goes on from there", said), said
    assert "Traceback" not in said
    deadline = time.monotonic() + 600
    while _group(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _group(process.pid), "workers outlive the command"


def _group(group: int) -> list[int]:
    """Processes of a group that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[2]) == group and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["wheel.inertia"], "varies nothing"),
        (["wheel.inertia=0.1:1"], "'0.1:1' is no range"),
        (["wheel.inertia=1,-1"], "out of range: inertia must be > 0"),
        (["wheel.inertia=1 kg,2 kg"], "does not fit: 'kg.m2' is expected"),
        (["wheel.inertai=1,2"], "did you mean 'inertia'"),
        (["whel.inertia=1,2"], "did you mean 'wheel'"),
        (["wheel.inertia=1:2:1"], "1 values cannot span a range"),
        (["wheel.inertia=0:2:3:log"], "no logarithmic spacing"),
        (["wheel.inertia=1,"], "a value is missing"),
        (["wheel.inertia=1,2", "wheel.inertia=3,4"], "varied twice"),
        (
            ["wheel.inertia=1,2", "blocks.wheel.inertia=3,4"],
            "'blocks.wheel.inertia' is varied twice, as 'wheel.inertia'",
        ),
        (["parameters.push=1,2", "push=3,4"], "'push' is varied twice, as 'parameters.push' too"),
        (["wheel.inertia=1,2", "wheel.inertia~10%"], "is on an axis and is drawn as well"),
        (["wheel.nothing~10%"], "no parameter 'wheel.nothing' that can be drawn"),
        (["source.height~10%"], "'source.height' follows push\\n.*--vary 'push~10%'"),
        (["wheel.inertia~wide"], "'wide' is no range to draw from"),
        (["wheel.inertia~2:1"], "is empty"),
        (["law.viscous_friction~10%"], "is 0, and a share of it as well"),
        (["push=1:2:400", "wheel.inertia=1:2:99999", "law.viscous_friction=0:1:99999"], "runs are too many"),
    ],
)
def test_what_is_refused(spin: Path, texts: list[str], message: str) -> None:
    with pytest.raises(FlexarmError, match=message) as refused:
        flexarm.sweep(spin, texts, "out.parquet", runs=2 if any("~" in text for text in texts) else None)
    assert "--set" not in str(refused.value)  # the place is where the user gave it
    assert not Path("out.parquet").exists()
    assert not Path("out.parquet.parts").exists()


def test_draws_need_a_number_and_a_seed_that_is_one(spin: Path) -> None:
    with pytest.raises(FlexarmError, match="how often is not said"):
        make_plan(load(spin), ["push~10%"])
    with pytest.raises(FlexarmError, match="without anything that is drawn"):
        make_plan(load(spin), ["push=1,2"], runs=5)
    with pytest.raises(FlexarmError, match="below zero"):
        make_plan(load(spin), ["push~10%"], runs=5, seed=-1)


MEASURE = """
import resource, sys
from flexarm.sweeps.sweep import sweep
if __name__ == "__main__":
    sweep(sys.argv[1], ["wheel.inertia~20%", "push~1:3"], sys.argv[2], runs=int(sys.argv[3]), workers=1)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_runs(spin: Path) -> None:
    """1e4 runs take within 10 MB of what 5e2 runs take."""
    Path("measure.py").write_text(MEASURE)
    environment = os.environ | {"PYTHONPATH": str(Path(flexarm.__file__).parent.parent)}
    peak = {}
    for runs in (500, 10_000):
        done = subprocess.run(
            [sys.executable, "measure.py", "spin.yaml", f"{runs}.parquet", str(runs)],
            check=True,
            capture_output=True,
            text=True,
            timeout=1800,
            env=environment,
        )
        peak[runs] = int(done.stdout) / 1024
        print(f"{runs} runs: {peak[runs]:.1f} MB")
    assert peak[10_000] < peak[500] + 10
    assert len(flexarm.read("10000.parquet")) == 10_000
