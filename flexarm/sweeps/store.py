"""The files of a sweep: parts that are each put in place whole, joined in the order of the runs when all are there."""

from __future__ import annotations

import contextlib
import functools
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from engine.errors import FlexarmError
from engine.files import check_suffix, json_text, writing
from flexarm.sweeps.plan import SweepPlan
from flexarm.sweeps.work import SUMMARIES, Span

GROUP = 5000
"""Rows of a row group."""

PLAN = "plan.json"
LOCK = ".lock"


def _remove(path: Path) -> None:
    """Take away a file, or a folder that somebody put in its place."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _broken() -> tuple[type[Exception], ...]:
    """What a file that is damaged or cannot be written raises."""
    import pyarrow

    return OSError, ValueError, pyarrow.ArrowException


def _described(text: bytes) -> dict[str, Any]:
    """What a file says of its plan; nothing if it is no such file."""
    try:
        found = json.loads(text)
    except RecursionError:
        return {}
    return found if isinstance(found, dict) else {}


_WORDS = {
    "digest": "the scenario or a file that its blocks read",
    "overrides": "--set",
    "axes": "--vary",
    "samples": "--vary",
    "draws": "--runs",
    "seed": "--seed",
    "outputs": "--outputs",
    "stop": "--stop",
    "step": "--step",
    "keep": "--keep",
    "version": "the version of flexarm",
    "metrics": "--metric or the file of its function",
    "correlation": "--from-fit",
}
"""What a user would call the parts of a plan."""


class SweepStore:
    """The table of a sweep, and beside it the folder ``TABLE.parts`` for as long as it is not finished.

    Args:
        table: the .parquet file to make.
        plan: of the sweep.
        provenance: further metadata of the files.
        restart: throw away what an earlier sweep left.

    Raises:
        FlexarmError: there is a table, or the parts of one, of another plan, or another process works on it.
    """

    def __init__(self, table: Path, plan: SweepPlan, provenance: dict[str, str], restart: bool = False) -> None:
        check_suffix(table, (".parquet",))
        self.table = table
        self.plan = plan
        self.parts = table.with_name(f"{table.name}.parts")
        self.trajectories = table.with_name("trajectories.parquet") if plan.keep is not None else None
        # Whole parts are kept, so a part is what an interruption may cost each worker.
        self.size = max(1, min(100, plan.total // 200))
        self.provenance = provenance
        self._lock: Any = None
        if restart:
            self._clear()

    def _clear(self) -> None:
        """Throw away what an earlier sweep left, once no other process is at work on it."""
        self._make()
        try:
            for left in self.parts.iterdir():
                if left.name == LOCK:
                    continue
                _remove(left)
            self.table.unlink(missing_ok=True)
        except OSError as error:
            self.close()
            raise FlexarmError(
                f"cannot throw away '{error.filename}': {error.strerror}", remedy="remove it by hand"
            ) from error

    def done(self) -> bool:
        """Whether the table is whole.

        Raises:
            FlexarmError: it is of another plan, or no table of a sweep.
        """
        if not self.table.exists():
            return False
        import pyarrow.parquet

        try:
            metadata = pyarrow.parquet.read_schema(self.table).metadata or {}
            described = _described(metadata.get(b"flexarm", b"{}"))
        except (OSError, ValueError, pyarrow.ArrowException):
            described = {}
        if described.get("plan_hash") != self.plan.hash:
            self._refuse(described.get("plan"), f"'{self.table}'")
        with contextlib.suppress(OSError):
            shutil.rmtree(self.parts, ignore_errors=True)
        return True

    def begin(self) -> list[tuple[int, int]]:
        """Make the folder of parts, or take up that of the same plan; spans of runs that are missing.

        Raises:
            FlexarmError: the folder belongs to another plan, or another process works in it.
        """
        self._make()
        manifest = self.parts / PLAN
        if manifest.exists():
            try:
                written = _described(manifest.read_bytes())
            except (OSError, ValueError):
                written = {}
            if written.get("plan_hash") != self.plan.hash:
                self._refuse(written.get("plan"), f"'{self.parts}'")
        else:
            with writing(manifest, (".json",)) as temporary:
                content = {"plan_hash": self.plan.hash, "scenario_hash": self.plan.digest, "plan": self.plan.numbers()}
                temporary.write_text(json_text(content, indent=2) + "\n", encoding="utf-8")
        for left in self.parts.glob(".*"):  # of a process that was killed while it wrote
            if left.name != LOCK and not left.is_dir():
                left.unlink(missing_ok=True)
        return [span for span in self.spans() if not self._is_whole(span)]

    def spans(self) -> Iterator[tuple[int, int]]:
        """First run, and the one after the last, of each part."""
        for first in range(0, self.plan.total, self.size):
            yield first, min(first + self.size, self.plan.total)

    def _make(self) -> None:
        try:
            self.parts.mkdir(exist_ok=True)
            self._hold()
        except OSError as error:
            raise FlexarmError(
                f"cannot work in the folder '{self.parts}': {error.strerror}",
                remedy="remove what is there, or write to another file",
            ) from error

    def _hold(self) -> None:
        """Let no other process work here; the system takes the lock back when this one ends, however it ends."""
        try:
            import fcntl
        except ImportError:
            return
        if self._lock is not None:
            return
        lock = (self.parts / LOCK).open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            lock.close()
            raise FlexarmError(
                f"another process is at work on '{self.table}'", remedy="wait for it, or write to another file"
            ) from error
        self._lock = lock

    def close(self) -> None:
        """Let others work here."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _refuse(self, other: Any, what: str) -> NoReturn:
        mine = self.plan.numbers()
        changed = [key for key in mine if isinstance(other, dict) and other.get(key) != mine[key]]
        words = ", ".join(dict.fromkeys(_WORDS.get(key, key) for key in changed))
        said = f"is of another sweep: since then {words} changed" if changed else "is no table of this sweep"
        raise FlexarmError(f"{what} {said}", remedy="write to another file, or begin again with --restart")

    def _part(self, span: tuple[int, int], kind: str = "runs") -> Path:
        return self.parts / f"{kind}-{span[0]:09d}.parquet"

    def _is_whole(self, span: tuple[int, int]) -> bool:
        """Whether the parts of a span are there and sound; others are removed, and their runs computed again."""
        kinds = [("runs", self._schema)]
        if self.trajectories is not None:
            kinds.append(("trajectories", self._long_schema))
        if not self._part(span).exists():
            return False
        try:
            for kind, schema in kinds:
                found = self._read(span, kind)
                if not found.schema.equals(schema.remove_metadata()):
                    raise ValueError(kind)
                if kind == "runs" and found["run"].to_pylist() != list(range(*span)):
                    raise ValueError(kind)
        except _broken():
            for kind, _ in kinds:
                _remove(self._part(span, kind))
            return False
        return True

    def _read(self, span: tuple[int, int], kind: str) -> Any:
        import pyarrow.parquet

        path = self._part(span, kind)
        return pyarrow.parquet.ParquetFile(path, page_checksum_verification=True).read()

    def write(self, span: tuple[int, int], found: Span) -> None:
        """Put a part in place."""
        import pyarrow
        import pyarrow.parquet

        made = [(self._part(span), self._schema, found.columns)]
        if found.trajectories is not None:
            # The rows' part says that the span is whole, so it comes last.
            made.insert(0, (self._part(span, "trajectories"), self._long_schema, found.trajectories))
        for path, schema, columns in made:
            with writing(path, (".parquet",)) as temporary:
                pyarrow.parquet.write_table(
                    pyarrow.table(columns, schema=schema.remove_metadata()), temporary, write_page_checksum=True
                )

    def finish(self) -> None:
        """Join the parts into the table, and remove them.

        Raises:
            FlexarmError: the table cannot be written, or a part is damaged; the parts stay.
        """
        try:
            if self.trajectories is not None:
                self._join(self.trajectories, self._long_schema, "trajectories")
            self._join(self.table, self._schema, "runs")
        except _broken() as error:
            for left in self.parts.glob(".joined-*"):
                left.unlink(missing_ok=True)
            raise FlexarmError(
                f"the parts in '{self.parts}' cannot be joined into '{self.table}': {str(error)[:300]}",
                remedy="make room and give the same command again; it goes on from here",
            ) from error
        self.close()
        shutil.rmtree(self.parts, ignore_errors=True)

    def _join(self, target: Path, schema: Any, kind: str) -> None:
        import pyarrow
        import pyarrow.parquet

        joined = self.parts / f".joined-{kind}.parquet"
        with pyarrow.parquet.ParquetWriter(joined, schema) as writer:
            waiting: list[Any] = []
            rows = 0
            for span in self.spans():
                waiting.append(self._read(span, kind).replace_schema_metadata(schema.metadata))
                rows += waiting[-1].num_rows
                if rows >= GROUP:
                    writer.write_table(pyarrow.concat_tables(waiting), row_group_size=rows)
                    waiting, rows = [], 0
            if waiting:
                writer.write_table(pyarrow.concat_tables(waiting), row_group_size=max(rows, 1))
        joined.replace(target)

    @functools.cached_property
    def _schema(self) -> Any:
        import pyarrow

        plan = self.plan
        fields: list[tuple[str, Any]] = [("run", pyarrow.int64())]
        units: dict[str, str] = {}
        for axis in plan.axes:
            fields.append((axis.key, pyarrow.float64() if axis.numbers else pyarrow.string()))
            units[axis.key] = axis.unit if axis.numbers else ""
        for sample in plan.samples:
            fields.append((sample.name, pyarrow.float64()))
            units[sample.name] = sample.unit
        for name, unit in plan.outputs:
            for kind in SUMMARIES:
                fields.append((f"{name}.{kind}", pyarrow.float64()))
                units[f"{name}.{kind}"] = unit
        for metric in plan.metrics:
            fields.append((metric.name, pyarrow.float64()))
            units[metric.name] = metric.unit
        fields.append(("failure", pyarrow.string()))
        return pyarrow.schema(fields, metadata=self._metadata({"run": "", **units, "failure": ""}, "sweep"))

    @functools.cached_property
    def _long_schema(self) -> Any:
        import pyarrow

        fields = [("run", pyarrow.int64()), ("time", pyarrow.float64())]
        fields += [(name, pyarrow.float64()) for name, _ in self.plan.outputs]
        units = {"run": "", "time": "s", **dict(self.plan.outputs)}
        return pyarrow.schema(fields, metadata=self._metadata(units, "trajectories"))

    def _metadata(self, units: dict[str, str], kind: str) -> dict[bytes, bytes]:
        plan = self.plan
        described = {
            "kind": kind,
            "units": units,
            **self.provenance,
            "inputs": [*(axis.key for axis in plan.axes), *(sample.name for sample in plan.samples)],
            "plan_hash": plan.hash,
            "plan": plan.numbers(),
        }
        return {b"flexarm": json_text(described).encode()}
