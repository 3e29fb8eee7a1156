"""The data file beside the page: every case, and what it was scored with."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks.concealed.drawing import Options
from benchmarks.proof import frozen
from benchmarks.proof.score import Score, scores
from engine.errors import FlexarmError
from engine.files import writing

DATA = frozen.ROOT / "benchmarks" / "results" / "proof.json"
CAUSES = Path(__file__).parent / "causes.yaml"
PACKAGES = ("flexarm", "numpy", "scipy", "casadi", "ziglang", "pysindy")


@dataclass(frozen=True)
class Proof:
    """What a page is made of.

    Attributes:
        about: versions, machine, what was frozen and what has changed since.
        rows: every case.
        sindy: case -> what PySINDy selected, as `benchmarks.peers.sindy` writes it.
    """

    about: dict[str, Any]
    rows: list[Score]
    sindy: dict[str, Any]


def gather(folder: Path) -> Proof:
    """Score a folder, and note with what.

    Raises:
        FlexarmError: the folder holds no results.
    """
    if not (folder / "results").is_dir():
        raise FlexarmError(f"'{folder}' holds no results", remedy="fill it by: python -m benchmarks.proof run")
    kept = sorted((folder / "sindy").glob("*.json"))
    sindy = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in kept}
    return Proof(about(), [_slim(row) for row in scores(folder)], sindy)


def _slim(row: Score) -> Score:
    usual = asdict(Options())
    options = {key: value for key, value in row.spec["options"].items() if _plain(value) != _plain(usual[key])}
    return Score(**{**row.__dict__, "spec": {**row.spec, "options": options}})


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def about() -> dict[str, Any]:
    """Versions, machine, and the commit that froze the rules beside the present state."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    told: dict[str, Any] = {"versions": versions, "machine": machine, "code": frozen.code_state()}
    try:
        told["commit"] = frozen._git(frozen.ROOT, "rev-parse", "HEAD")
        told["trees"] = frozen.trees("HEAD")
        told["changed_since_commit"] = frozen.changes("HEAD")
        if made := frozen.frozen():
            told["frozen"] = {
                **asdict(made),
                "changed_since": frozen.changes(made.commit),
                "judges_changed_since": frozen.changes(made.commit, folders=frozen.JUDGES),
            }
    except FlexarmError as error:
        told["git"] = str(error)
    return told


def together(proof: Proof, earlier: Proof) -> Proof:
    """Cases, and with them those of an earlier score whose seeds follow from the same commit.

    The full form takes hours: it can go on another day, on another machine.

    Raises:
        FlexarmError: no rules are frozen.
    """
    made = frozen.frozen()
    if made is None:
        raise FlexarmError("no rules are frozen", remedy="leave '--add' out")
    return joined(proof, replace(earlier, rows=[row for row in earlier.rows if row.frozen == made.commit]))


def joined(proof: Proof, earlier: Proof) -> Proof:
    """Cases, and with them those of an earlier score that were not run again. Each says by which program it was run."""
    rows = {row.name: row for row in earlier.rows if row.outcome != "not run"}
    rows |= {row.name: row for row in proof.rows if row.name not in rows or row.outcome != "not run"}
    sindy = {name: found for name, found in earlier.sindy.items() if name in rows}
    return Proof(proof.about, [rows[name] for name in sorted(rows)], sindy | proof.sindy)


def save(proof: Proof, path: Path = DATA) -> None:
    """Write the data file: a line for each case."""
    rows = ",\n".join(json.dumps(asdict(row)) for row in proof.rows)
    head = json.dumps({"about": proof.about, "sindy": proof.sindy}, indent=1)[:-2]
    with writing(path, (".json",)) as temporary:
        temporary.write_text(f'{head},\n "rows": [\n{rows}\n]}}\n', encoding="utf-8")


def load(path: Path = DATA) -> Proof:
    """Read the data file.

    Raises:
        FlexarmError: there is none.
    """
    if not path.exists():
        raise FlexarmError(f"there is no '{path}'", remedy="write it by: python -m benchmarks.proof page -o DIR")
    data = json.loads(path.read_text(encoding="utf-8"))
    return Proof(data["about"], [_row(row) for row in data["rows"]], data["sindy"])


def _row(data: Mapping[str, Any]) -> Score:
    known = {f.name for f in fields(Score)}
    values: dict[str, Any] = {
        key: _tuples(value) if isinstance(value, list) else value for key, value in data.items() if key in known
    }
    return Score(**values)


def _tuples(values: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(tuple(v) if isinstance(v, list) else v for v in values)


def causes(path: Path = CAUSES) -> dict[str, str]:
    """Known causes of failures: the name of a case, or a pattern for ``suite plant effect@place``, -> a sentence."""
    if not path.exists():
        return {}
    from ruamel.yaml import YAML

    return {str(k): str(v) for k, v in (YAML(typ="safe").load(path.read_text(encoding="utf-8")) or {}).items()}
