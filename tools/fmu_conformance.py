"""Writes docs/fmu-conformance.md and docs/fmu-importers.md: ``python -m tools.fmu_conformance`` runs the FMU tests.

It runs file by file, keeps the report of each in ``build/fmu-conformance`` and writes the pages after each, so that it
may be interrupted: the next call goes on with the files that have no report of the present sources. Names of files run
those alone; ``--importers`` runs the table of Model Exchange alone; ``--page`` writes the pages from what is kept.

Figures of cost come from benchmarks/results/fmu.json, which ``python -m benchmarks.bench_fmu`` writes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "fmu-conformance.md"
IMPORTERS = ROOT / "docs" / "fmu-importers.md"
REPORTS = ROOT / "build" / "fmu-conformance"
TESTS = ROOT / "tests" / "fmu"
FIGURES = ROOT / "benchmarks" / "results" / "fmu.json"

CHECKS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (
        "FMPy, the XML schemas and fmutool find no error; fmuCheck and VDMCheck neither, where they are installed",
        (
            "test_archive.test_fmpy_finds_no_problem",
            "test_fmi3.test_valid_and_equal_to_fmi2",
            "test_importers.test_fmutool_finds_no_error",
            "test_importers.test_other_checkers_find_no_error",
            "test_python_backend.test_valid_and_marked",
        ),
    ),
    (
        "Exported symbols are exactly the FMI functions",
        (
            "test_archive.test_symbols_are_exactly_the_functions_of_fmi",
            "test_archive.test_windows_binary_exports_the_functions",
            "test_python_process.test_symbols_are_functions_of_fmi_alone",
            "test_fmi3.test_symbols_are_exactly_the_functions_of_fmi3",
        ),
    ),
    (
        "Runs in a host without Python, with an empty environment",
        (
            "test_host.test_runs_with_an_empty_environment_and_agrees_with_the_runner",
            "test_python_process.test_a_host_without_python_agrees_with_the_runner",
        ),
    ),
    (
        "Same result within 1e-12 in FMPy, libcosimpy and ecospy; win64 under Wine within 1e-9",
        (
            "test_importers.test_libcosimpy",
            "test_importers.test_ecospy",
            "test_wine.test_the_windows_binary_under_wine",
        ),
    ),
    (
        "Equals `flexarm run` to 1e-12, a fine adaptive solver within a bound; order 4",
        (
            "test_time.test_equals_the_runner_at_the_same_step",
            "test_time.test_every_shipped_scenario_equals_the_runner",
            "test_time.test_agrees_with_an_adaptive_solver_and_has_order_four",
            "test_reference.test_outputs_equal_those_of_hand_written_c",
            "test_python_backend.test_equals_the_runner",
        ),
    ),
    (
        "1 ms and 10 ms communication steps are bit-identical; irregular steps end right",
        (
            "test_time.test_long_and_short_communication_steps_are_bit_identical",
            "test_time.test_irregular_steps_end_at_the_right_time_and_value",
        ),
    ),
    (
        "1000 interleaved instances, 8 threads, two FMUs with overlapping names",
        (
            "test_host.test_interleaved_instances_do_not_disturb_one_another",
            "test_host.test_a_thousand_instances",
            "test_host.test_threads_give_the_serial_result",
            "test_state.test_two_fmus_in_one_process_do_not_meet",
            "test_python_process.test_instances_and_threads_do_not_disturb_one_another",
        ),
    ),
    (
        "Loaded 2000 times, 1e6 steps: no crash, no leak; Valgrind and sanitizers clean",
        (
            "test_host.test_loading_and_freeing_two_thousand_times",
            "test_host.test_loading_and_freeing_leaves_no_handle",
            "test_python_process.test_loading_and_freeing_leaves_no_handle",
            "test_host.test_memory_does_not_grow_over_a_million_steps",
            "test_host.test_valgrind_finds_nothing",
            "test_sanitized.test_every_function_of_the_standard_is_driven",
            "test_sanitized.test_sanitizers_find_nothing",
        ),
    ),
    (
        "Reset equals a fresh instance bit for bit",
        ("test_state.test_reset_equals_a_fresh_instance", "test_python_backend.test_reset_equals_a_fresh_instance"),
    ),
    (
        "State rolls back bit for bit, travels to a new process; damaged or foreign ones are refused",
        (
            "test_state.test_a_saved_state_rolls_back_bit_for_bit",
            "test_state.test_a_serialised_state_continues_in_a_new_process",
            "test_state.test_damaged_and_foreign_states_are_refused",
            "test_state.test_forged_states_are_refused_or_harmless",
            "test_python_backend.test_the_whole_state_comes_back",
        ),
    ),
    (
        "Directional derivatives against central differences within 1e-6; columns equal A, B, C, D",
        (
            "test_derivatives.test_columns_are_the_linear_model",
            "test_derivatives.test_every_pair_agrees_with_central_differences",
            "test_derivatives.test_input_derivatives_agree_with_central_differences",
            "test_linear.test_resources_equal_the_directional_derivatives",
        ),
    ),
    (
        "Bad calls: a defined status and a message, value unchanged, no crash",
        (
            "test_robust.test_unknown_references",
            "test_robust.test_wrong_types",
            "test_robust.test_only_inputs_and_parameters_can_be_set",
            "test_robust.test_values_that_are_not_finite",
            "test_robust.test_parameters_out_of_range",
            "test_robust.test_steps_that_cannot_be_done",
            "test_robust.test_missing_pointers",
            "test_robust.test_calls_before_the_start",
            "test_robust.test_calls_out_of_order",
            "test_robust.test_instances_that_cannot_be_made",
            "test_fmi3.test_refusals",
            "test_python_backend.test_bad_calls_end_in_a_message_and_no_crash",
            "test_python_backend.test_calls_before_the_start_and_after_the_end",
        ),
    ),
    ("A state that is not finite makes doStep an error", ("test_robust.test_a_state_that_is_not_finite_is_an_error",)),
    (
        "Tuning in mid-run equals a restart from the same state",
        ("test_state.test_tuning_equals_a_restart_from_the_same_state",),
    ),
    (
        "Parameters set against one another are an error with the reason in the log",
        ("test_relations.test_an_importer_is_refused_and_may_mend_it",),
    ),
    ("Start values read back equal the XML", ("test_robust.test_start_values_read_back",)),
    (
        "Model Exchange under CVODE agrees with Co-Simulation; stick-slip instants",
        (
            "test_exchange.test_cvode_agrees_with_fine_co_simulation",
            "test_exchange.test_stick_slip_happens_at_the_same_instants",
            "test_exchange.test_indicators_are_named_in_the_documentation",
            "test_scenarios.test_cvode_at_the_usual_tolerance_agrees_with_co_simulation",
            "test_start.test_a_mode_switch_reports_changed_states",
        ),
    ),
    (
        "Twists as states: values, rates, derivatives, starts, saved states, in FMI 2 and 3",
        (
            "test_twists.test_states_and_their_rates_are_those_of_the_names",
            "test_twists.test_directional_derivatives_are_those_of_the_states_shown",
            "test_twists.test_starts_are_set_on_angles_and_twists_follow",
            "test_twists.test_saved_states_bring_the_twists_back",
        ),
    ),
    (
        "FMI 3 event mode: early return at the events, limits from both sides, clocks; FMPy and fmusim",
        (
            "test_event_mode.test_fmpy_with_event_mode_agrees_with_plain_co_simulation",
            "test_event_mode.test_early_returns_are_the_events_of_the_simulation",
            "test_event_mode.test_values_before_event_mode_are_limits_from_the_left",
            "test_event_mode.test_clocks_tick_in_event_mode_and_inputs_of_that_instant_count",
            "test_event_mode.test_fmusim_uses_event_mode",
        ),
    ),
    (
        "Arrays of FMI 3: the same values, tangents and results as the scalars",
        (
            "test_arrays.test_description_is_valid_and_holds_the_same_states",
            "test_arrays.test_fmpy_gives_the_same_results",
            "test_arrays.test_values_and_directional_derivatives_are_those_of_the_scalars",
            "test_arrays.test_fmusim_reads_arrays",
        ),
    ),
    (
        "What users of importers report: zeros at initialization, false loops, hidden delays, missed events",
        (
            "test_reported.test_outputs_have_their_values_at_initialization",
            "test_reported.test_no_false_algebraic_loop",
            "test_reported.test_no_hidden_delay",
            "test_reported.test_an_importer_that_looks_at_its_steps_alone_misses_no_event",
        ),
    ),
    (
        "Foreign plants under our controllers, and the reverse",
        (
            "test_foreign_plants.test_a_foreign_plant_under_our_controller",
            "test_foreign_plants.test_a_foreign_controller_before_our_plant",
            "test_bouncing_ball.test_our_controller_catches_the_ball",
            "test_bouncing_ball.test_our_controller_as_an_fmu_catches_it_in_a_master",
            "test_bouncing_ball.test_the_reference_ball_leads_our_drive",
        ),
    ),
    ("Sources rebuilt with gcc agree within 1e-12", ("test_archive.test_gcc_rebuilds_it_to_the_same_results",)),
    (
        "The SSP of arm and drive converges to the single FMU",
        (
            "test_ssp.test_converges_with_order_two_when_rates_are_passed_on",
            "test_ssp.test_converges_in_fmpys_own_co_simulation",
            "test_ssp.test_converges_with_backlash_and_friction",
            "test_ssp.test_fmi_3",
            "test_importers.test_an_ssp_converges_to_the_scenario",
            "test_importers.test_importers_agree_on_an_ssp",
            "test_coupling.test_a_master_of_twenty_lines",
            "test_coupling.test_libcosim_and_ecos",
        ),
    ),
    (
        "Python in a process: which one, its death, its end with the importer, signals, prints, fmusim, Wine",
        (
            "test_python_process.test_the_chosen_python_must_do",
            "test_python_process.test_the_exporting_python_then_the_one_on_the_path",
            "test_python_process.test_another_version_is_refused",
            "test_python_process.test_a_process_that_dies_is_an_error_with_its_last_words",
            "test_python_process.test_the_process_ends_with_its_host",
            "test_python_process.test_signals",
            "test_python_process.test_what_python_prints_is_logged",
            "test_python_process.test_fmusim",
            "test_wine.test_python_in_a_process_under_wine",
        ),
    ),
)
"""The acceptance checks in their order, and the tests that prove each: file and function in tests/fmu."""


@dataclass
class Outcome:
    """What became of a test, all its cases together."""

    passed: int = 0
    failed: int = 0
    skipped: tuple[str, ...] = ()
    figures: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """In words."""
        if not self.passed + self.failed + len(self.skipped):
            return "not run"
        parts = [f"{self.passed} passed"] if self.passed else []
        parts += [f"**{self.failed} failed**"] if self.failed else []
        parts += [f"skipped: {reason}" for reason in dict.fromkeys(self.skipped)]
        return ", ".join(parts) + "".join(f"; {figure}" for figure in dict.fromkeys(self.figures))


def outcomes(report: ET.Element) -> dict[str, Outcome]:
    """Outcomes by file and function, from pytest's JUnit report."""
    found: dict[str, Outcome] = {}
    for case in report.iter("testcase"):
        key = f"{case.get('classname', '').rpartition('.')[2]}.{case.get('name', '').partition('[')[0]}"
        outcome = found.setdefault(key, Outcome())
        skipped = case.find("skipped")
        if case.find("failure") is not None or case.find("error") is not None:
            outcome.failed += 1
        elif skipped is not None:
            outcome.skipped += (skipped.get("message", "").removeprefix("Skipped: ").partition(":")[0],)
        else:
            outcome.passed += 1
        outcome.figures += tuple(
            f"{p.get('name')} {p.get('value')}" for p in case.iter("property") if p.get("name") != "error"
        )
    return found


EXCHANGERS = {
    "FMPy": "test_cvode_at_the_usual_tolerance_agrees_with_co_simulation",
    "fmusim": "test_fmusim_agrees_with_co_simulation",
    "PyFMI": "test_pyfmi_agrees_with_co_simulation",
}
"""Importers that do Model Exchange, and the test of tests/fmu/test_scenarios.py that has each case."""


def exchange(report: ET.Element) -> list[str]:
    """The table of Model Exchange: a row for each scenario, a column for each importer and version of FMI."""
    cells: dict[tuple[str, str], str] = {}
    for case in report.iter("testcase"):
        test, _, case_of = case.get("name", "").partition("[")
        version, _, name = case_of.removesuffix("]").partition("-")
        for importer, function in EXCHANGERS.items():
            if test == function:
                failed = case.find("failure") is not None or case.find("error") is not None
                figure = next((p.get("value", "") for p in case.iter("property")), "failed" if failed else "passed")
                skipped = case.find("skipped") is not None
                text = "not there" if skipped else f"**{figure}**" if failed else figure
                cells[name, f"{importer}, FMI {version}"] = text
    columns = [f"{importer}, FMI {version}" for importer in EXCHANGERS for version in (2, 3)]
    lines = [f"| FMU | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    names = sorted({name for name, _ in cells})
    return lines + [f"| {n} | {' | '.join(cells.get((n, column), 'not run') for column in columns)} |" for n in names]


def versions() -> str:
    """The importers that were there, with their versions."""
    packages = ("fmpy", "libcosimpy", "ecospy", "fmu_manipulation_toolbox")
    found = [f"{name} {metadata.version(name)}" for name in packages]
    fmusim, python = os.environ.get("FLEXARM_FMUSIM") or shutil.which("fmusim"), os.environ.get("FLEXARM_PYFMI")
    if fmusim:
        said = subprocess.run([fmusim, "--version"], capture_output=True, text=True, check=False).stdout.split()
        found.append(f"fmusim {said[1] if len(said) > 1 else ''}".strip())
    if python:
        program = "import pyfmi; print(pyfmi.__version__)"
        said = subprocess.run([python, "-c", program], capture_output=True, text=True, check=False).stdout.split()
        found.append(f"PyFMI {said[-1] if said else ''}".strip())
    return ", ".join(found)


def importers(table: Sequence[str]) -> str:
    """The document of Model Exchange, importer by importer."""
    lines = [
        "# FMU importers",
        "",
        "Written by `python -m tools.fmu_conformance --importers`; do not edit.",
        "",
        "Every shipped scenario in Model Exchange at a relative tolerance of 1e-4, against its Co-Simulation: the",
        "largest difference of any output over its range, in 2 s; in bold where it is above 1 %.",
        "",
        f"Importers: {versions()}. Which FMUs run in libcosim, Ecos, fmutool and Wine, and how well, is among the",
        "[checks](fmu-conformance.md).",
        "",
        *table,
    ]
    return "\n".join(lines) + "\n"


def page(found: dict[str, Outcome], figures: dict[str, float] | None, older: Sequence[str] = ()) -> str:
    """The document; ``older`` are the test files whose last run was of earlier sources."""
    lines = [
        "# FMU conformance",
        "",
        "Written by `python -m tools.fmu_conformance`; do not edit. Tests are in `tests/fmu`. Those named",
        "`test_python_backend` and `test_python_process` are of FMUs made with `--backend python`, the others of",
        "generated C.",
        *(
            ["", f"Last run before the latest change of sources: {', '.join(f'`{name}`' for name in older)}."]
            if older
            else []
        ),
        "",
        "| # | Check | Test | Last run |",
        "|---|---|---|---|",
    ]
    for number, (check, tests) in enumerate(CHECKS, 1):
        for i, test in enumerate(tests):
            head = f"| {number} | {check} " if i == 0 else "| | "
            lines.append(f"{head}| `{test}` | {found.get(test, Outcome()).text} |")
    lines += ["", "## Cost", ""]
    if figures is None:
        lines.append("Not measured: run `python -m benchmarks.bench_fmu`.")
    else:
        lines += [
            "The 8-state reference arm (motor, gear, nonlinear link of three modes), by `benchmarks/bench_fmu.py`.",
            "The hand-written loop is `benchmarks/reference/arm8.c`; like the FMU it leaves every parameter tunable.",
            "",
            "| Figure | Measured | Bound |",
            "|---|---|---|",
            f"| 1 ms doStep / the same step in a hand-written C loop | {figures['ratio_to_hand_written']:.2f} | 1.0 |",
            f"| Saving and restoring the state / a 1 ms doStep | {figures['states_in_steps']:.2f} | 2 |",
            f"| 1 ms doStep of a pythonfmu FMU of the same model / of ours | {figures['pythonfmu_ratio']:.0f} | |",
            f"| Difference of the outputs from the hand-written loop after 1 s | "
            f"{figures['difference_from_hand_written']:.1e} | 1e-9 |",
            f"| Export with a warm cache, for each platform | {figures['export_warm_s_per_platform']:.2f} s | 1 s |",
            f"| Archive for two platforms | {figures['two_platforms_kB']:.0f} kB | 120 kB |",
        ]
    return "\n".join(lines) + "\n"


def sources() -> str:
    """A hash of what the tests of FMUs depend on: the library, the scenarios and the tests' own files."""
    digest = hashlib.sha256()
    for folder in ("engine", "blocks", "scenarios", "fmu", "flexarm", "tests/fmu"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def report_of(file: Path) -> Path:
    """Where the report of a test file is kept."""
    return REPORTS / f"{file.stem}.xml"


def run(file: Path, identity: str, arguments: Sequence[str]) -> bool:
    """Run a test file and keep its report; False if a test failed. Interrupted, no report is kept."""
    REPORTS.mkdir(parents=True, exist_ok=True)
    made = REPORTS / f".{file.stem}.xml"
    command = [sys.executable, "-m", "pytest", "-q", str(file), "-m", "slow or not slow", f"--junitxml={made}"]
    code = subprocess.run([*command, *arguments], cwd=ROOT, check=False).returncode
    if code not in (0, 1, 5):  # passed, failed, no tests
        raise SystemExit(code)
    root = ET.parse(made).getroot()
    root.set("sources", identity)
    ET.ElementTree(root).write(made)
    made.replace(report_of(file))
    return code != 1


def kept(files: Sequence[Path]) -> ET.Element:
    """The reports of the files that have one, in one element."""
    whole = ET.Element("reports")
    whole.extend(ET.parse(report_of(file)).getroot() for file in files if report_of(file).exists())
    return whole


def is_fresh(file: Path, identity: str) -> bool:
    """Whether the kept report of a file is of these sources."""
    return report_of(file).exists() and ET.parse(report_of(file)).getroot().get("sources") == identity


def write(files: Sequence[Path], identity: str) -> None:
    """Write both pages from the reports that are kept."""
    root = kept(files)
    if report_of(TESTS / "test_scenarios.py").exists():
        IMPORTERS.write_text(importers(exchange(root)), encoding="utf-8")
    figures = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else None
    older = [file.stem for file in files if report_of(file).exists() and not is_fresh(file, identity)]
    PAGE.write_text(page(outcomes(root), figures, older), encoding="utf-8")


def main(arguments: Sequence[str] = ()) -> int:
    """Run what has no report yet, or what is named, and write the pages; 1 if a test failed."""
    files = sorted(TESTS.glob("test_*.py"))
    names = {file.stem: file for file in files}
    parser = argparse.ArgumentParser(prog="python -m tools.fmu_conformance", description=__doc__, allow_abbrev=False)
    parser.add_argument("files", nargs="*", metavar="FILE", help=f"of {', '.join(names)}")
    parser.add_argument("--importers", action="store_true", help="run the table of Model Exchange alone")
    parser.add_argument("--page", action="store_true", help="run nothing, write the pages from what is kept")
    parser.epilog = "Other options, such as -x, go to pytest; their values with =, as -k=NAME."
    given, further = parser.parse_known_args(arguments)
    asked = [name.removesuffix(".py") for name in given.files] + ["test_scenarios"] * given.importers
    if unknown := [name for name in asked if name not in names]:
        parser.error(f"no file {', '.join(unknown)} in tests/fmu; there are {', '.join(names)}")
    identity, passed = sources(), True
    waiting = [names[name] for name in asked] or [file for file in files if not is_fresh(file, identity)]
    for k, file in enumerate([] if given.page else waiting, 1):
        print(f"{k} of {len(waiting)}: {file.name}", flush=True)
        passed &= run(file, identity, further)
        write(files, identity)
    write(files, identity)
    print(f"written: {PAGE.relative_to(ROOT)}, {IMPORTERS.relative_to(ROOT)}")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
