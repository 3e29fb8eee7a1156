"""The compiled runtime: the C struct of a run, filled and called through ctypes, which holds no interpreter lock.

A model begins as byte code (`engine.bytecode`), translated to machine code where that is possible, and gets C of its
own once that pays. All give the same numbers to the bit, so when it changes over shows in nothing but time.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from ctypes import POINTER, c_double, c_int32, c_int64, c_void_p
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine import bytecode
from engine.codegen import simulation_source
from engine.compile import known, library
from engine.external import Calls
from engine.model import Model, Vector

OK, NOT_FINITE, CHATTER, CANCELLED, NO_MODE, EXTERNAL = range(6)
EVENTS_PER_STEP = 200


@dataclass(frozen=True, eq=False)
class Timetable:
    """When things happen that do not depend on what a model does: instants are whole ticks of ``resolution`` seconds.

    Runs that differ in parameters, starts and steps alone share one; see ``simulate.c`` for the attributes.

    Attributes:
        time: instants of the rows (s), from the start of the run, as whoever asked for them wrote them.
    """

    resolution: float
    rows: NDArray[np.int64]
    time: Vector
    period: NDArray[np.int64]
    offset: NDArray[np.int64]
    knot: NDArray[np.int64]
    value: NDArray[np.float64]
    linear: NDArray[np.int32]

    @property
    def outputs(self) -> int:
        """Rows after the first."""
        return len(self.rows) - 1

    def ticking(self, tick: float, count: int) -> Timetable:
        """The same with another tick (s), and so many rows after the first, one at each tick."""
        rows = np.arange(count + 1)
        return replace(self, resolution=tick, rows=rows, time=rows * np.float64(tick))

    @functools.cached_property
    def apart(self) -> float:
        """The longest time (s) between rows."""
        return float(np.diff(self.rows).max(initial=0)) * self.resolution

    @functools.cached_property
    def struct(self) -> _Job:
        """The struct of a run with these instants, the rest of it empty."""
        c = _Job()
        c.resolution, c.outputs = self.resolution, self.outputs
        c.knots = len(self.knot)
        for name in ("rows", "period", "offset", "knot", "value", "linear"):
            setattr(c, name, getattr(self, name).ctypes.data)
        return c

    @functools.cached_property
    def mark(self) -> bytes:
        """Equal for those with the same instants, whatever the inputs are there."""
        sizes = (self.resolution, self.outputs, len(self.period))
        arrays = (self.rows, self.period, self.offset, self.knot)
        return hashlib.sha256(b"".join([repr(sizes).encode(), *(array.tobytes() for array in arrays)])).digest()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "struct"}


@dataclass
class Job:
    """One run in the runtime's form; see ``simulate.c``."""

    p: Vector
    x0: Vector
    d0: Vector
    m0: Vector
    hmax: float
    timetable: Timetable
    record_states: bool = False
    log_capacity: int = 0
    t0: float = 0.0
    cancel: Any = None

    @property
    def resolution(self) -> float:
        """Seconds in a tick."""
        return self.timetable.resolution

    @property
    def outputs(self) -> int:
        """Rows after the first."""
        return self.timetable.outputs


@dataclass
class Outcome:
    """Results of a run; after a failure the rows of ``y``, ``states`` and ``modes`` from ``row`` on hold no result."""

    y: NDArray[np.float64]
    states: NDArray[np.float64] | None
    modes: NDArray[np.float64] | None
    x1: Vector
    d1: Vector
    m1: Vector
    log: NDArray[np.float64]
    steps: int
    events: int
    row: int
    status: int
    culprit: int
    t1: float
    cause: BaseException | None = None


_External = ctypes.CFUNCTYPE(c_int32, c_int32, c_double, POINTER(c_double), POINTER(c_double))


class _Job(ctypes.Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("p", "x0", "d0", "m0")),
        *((name, c_double) for name in ("t0", "resolution", "hmax")),
        ("outputs", c_int64),
        ("rows", c_void_p),
        *((name, c_void_p) for name in ("period", "offset", "stage")),
        ("knots", c_int64),
        *((name, c_void_p) for name in ("knot", "value", "linear")),
        *((name, c_void_p) for name in ("y", "states", "modes", "x1", "d1", "m1", "log")),
        ("log_capacity", c_int64),
        ("log_length", c_int64),
        ("steps", c_int64),
        ("events", c_int64),
        ("row", c_int64),
        ("cancel", POINTER(c_int32)),
        ("status", c_int32),
        ("culprit", c_int32),
        ("t1", c_double),
        ("external", _External),
        ("code", c_void_p),
    )


@functools.lru_cache(maxsize=64)
def _loaded(source: str) -> Any:
    function = library(source).fa_simulate
    function.argtypes = [POINTER(_Job), ctypes.c_void_p]
    function.restype = ctypes.c_int
    return function


_sources: dict[str, str] = {}


def entry(model: Model) -> Any:
    """The compiled ``fa_simulate`` of a model.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    return _loaded(_source(model))


def _source(model: Model) -> str:
    source = _sources.get(model.law)
    if source is None:
        source = _sources[model.law] = simulation_source(model)
    return source


_interpreters: dict[tuple[int | None, Callable[[str], Any]], Any] = {}
_interpreters_lock = threading.Lock()


def interpreter(room: int | None, load: Callable[[str], Any]) -> Any:
    """The runtime of byte code, with room for so many tangents or without any, or a function of it, loaded once.

    Args:
        room: see `bytecode.source`.
        load: compiles and loads its C, and finds the function.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    with _interpreters_lock:
        if (room, load) not in _interpreters:
            _interpreters[room, load] = load(bytecode.source(room))
        return _interpreters[room, load]


MACHINE_CODE = True
"""Whether byte code is translated, which changes nothing but time."""


def translated(code: bytecode.Code | None, room: int | None = None) -> bytecode.Code | None:
    """Byte code with machine code beside it, where this machine takes that.

    Args:
        code: the byte code.
        room: that it is run with, as of `interpreter`.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    if code is not None and MACHINE_CODE:
        code.translate(interpreter(room, library))
    return code


LOOK = 0.016
"""Time lost (s) after which the cache is searched for the model's own code: a few times what that takes."""

ENOUGH, ENOUGH_FOR_EACH = 0.12, 2e-4
"""Time lost (s) after which the model's own code is compiled, and more for each instruction of a step: its cost."""


def steps_of(job: Job) -> int:
    """About how many steps a run takes; one that ends before its first row may have steps of any shortness."""
    if not job.outputs:
        return len(job.timetable.knot)
    return job.outputs * math.ceil(job.timetable.apart / job.hmax) + len(job.timetable.knot)


class Way:
    """How the runs of a model are carried out: by byte code, until its own compiled code pays.

    Args:
        code: makes the byte code; None for a model that it cannot serve.
        source: makes the C.
        load: compiles and loads the C.
        known: whether it is compiled already.

    Attributes:
        own, code: the model's compiled code, if it is made, and its byte code.
        alone: steps that the runs of a group took one by one when it was last worked on together, as a share of all.
    """

    def __init__(
        self,
        code: Callable[[], bytecode.Code | None],
        source: Callable[[], str],
        load: Callable[[str], Any],
        known: Callable[[str], bool],
    ) -> None:
        self._source, self._load, self._known = source, load, known
        self._lock = threading.Lock()
        self._lost = 0.0
        self._looked = False
        self.alone = 0.0
        self.own: Any = None
        self.code = code()
        if self.code is None:
            self.own = load(source())

    def chosen(self, steps: float) -> bool:
        """Whether runs are for the model's own code, `own`, which is made if need be, or for byte code, `code`.

        Args:
            steps: that they take.
        """
        with self._lock:
            if self.own is None:
                assert self.code is not None
                self._lost += steps * self.code.step * self.code.slower
                enough = self._lost > ENOUGH + ENOUGH_FOR_EACH * self.code.step
                if enough or (not self._looked and self._lost > LOOK):
                    self._looked = True
                    source = self._source()
                    if enough or self._known(source):
                        self.own = self._load(source)
            return self.own is not None


_ways: OrderedDict[Hashable, Way] = OrderedDict()
_ways_lock = threading.Lock()
MOST_WAYS = 500


def way(key: Hashable, make: Callable[[], Way]) -> Way:
    """The way that is kept under a key, or a new one.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    with _ways_lock:
        found = _ways.get(key)
        if found is not None:
            _ways.move_to_end(key)
            return found
    made = make()
    with _ways_lock:
        found = _ways.setdefault(key, made)
        while len(_ways) > MOST_WAYS:
            _ways.popitem(last=False)
    return found


def forget() -> None:
    """Begin again as in a new process, such as with another compiler."""
    with _ways_lock, _interpreters_lock:
        _ways.clear()
        _interpreters.clear()
        _loaded.cache_clear()


def way_of(model: Model) -> Way:
    """How the runs of a model are carried out that have no tangents.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    return way(
        model.law,
        lambda: Way(lambda: translated(bytecode.simulation_code(model)), lambda: _source(model), _loaded, known),
    )


def run(model: Model, job: Job) -> Outcome:
    """Carry out one run. The interpreter lock is free while C works.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    found = way_of(model)
    if found.chosen(steps_of(job)):
        return call(model, job, lambda c: found.own(ctypes.byref(c), None))
    function, code = interpreter(None, _loaded), found.code
    return call(model, job, lambda c: function(ctypes.byref(c), None), code)


class Call:
    """The C struct of a run, with the arrays that it points to.

    Args:
        model: the model.
        job: the run.
        code: the model's byte code, if the function that is called is for that.

    Attributes:
        struct: what C reads and fills.
    """

    def __init__(self, model: Model, job: Job, code: bytecode.Code | None = None) -> None:
        rows = job.outputs + 1
        self._y = np.empty((rows, len(model.outputs)))
        self._states = np.empty((rows, len(model.states))) if job.record_states else None
        self._modes = np.empty((rows, len(model.modes))) if job.record_states else None
        # To ask arrays one by one where they lie would take as long as a short run.
        self._given = np.concatenate([job.p, job.x0, job.d0, job.m0], dtype=np.float64)
        self._sizes = len(model.states), len(model.memories), len(model.modes)
        self._ends = np.zeros(sum(self._sizes))
        self._log = np.empty((job.log_capacity, 3))
        self.struct = c = _Job.from_buffer_copy(job.timetable.struct)
        states, memories, _ = self._sizes
        c.p = self._given.ctypes.data
        c.x0 = c.p + 8 * len(job.p)
        c.d0 = c.x0 + 8 * states
        c.m0 = c.d0 + 8 * memories
        c.x1 = self._ends.ctypes.data
        c.d1 = c.x1 + 8 * states
        c.m1 = c.d1 + 8 * memories
        self._timetable = job.timetable
        if model.lines:
            self._stages = np.array([stage for line in model.lines for stage in line.stages], np.int64)
            c.stage = self._stages.ctypes.data
        c.t0, c.hmax = job.t0, job.hmax
        c.y, c.log = self._y.ctypes.data, self._log.ctypes.data
        if self._states is not None and self._modes is not None:
            c.states, c.modes = self._states.ctypes.data, self._modes.ctypes.data
        c.log_capacity = job.log_capacity
        c.code = None if code is None else code.address
        if job.cancel is not None:
            c.cancel = ctypes.pointer(job.cancel)

    def outcome(self, cause: BaseException | None = None) -> Outcome:
        """What C has filled in; and what an external function failed with."""
        c, log = self.struct, self._log[: self.struct.log_length]
        n, m, _ = self._sizes
        x1, d1, m1 = self._ends[:n], self._ends[n : n + m], self._ends[n + m :]
        y, states, modes = self._y, self._states, self._modes
        return Outcome(y, states, modes, x1, d1, m1, log, c.steps, c.events, c.row, c.status, c.culprit, c.t1, cause)


def call(model: Model, job: Job, function: Callable[[Any], int], code: bytecode.Code | None = None) -> Outcome:
    """Fill the C struct of a run, call ``function`` with it, and collect the results.

    Args:
        model: the model.
        job: the run.
        function: carries it out.
        code: the model's byte code, if the function is for that.

    Raises:
        SimulationError: an external function cannot be made.
    """
    made = Call(model, job, code)
    calls = Calls(model)
    if model.externals:
        made.struct.external = _callback(calls)

    def work() -> None:
        function(made.struct)

    _carry(model, [job], [made], work)
    calls.finish()
    _pass_on()
    return made.outcome(calls.failure)


def call_together(
    model: Model, jobs: Sequence[Job], function: Callable[[Any, int], Any], code: bytecode.Code | None
) -> list[Outcome]:
    """The same for several runs, which share the flag that ends them, of a model that calls no Python functions.

    Args:
        model: the model.
        jobs: the runs.
        function: carries them out, given the addresses of their structs and how many there are.
        code: as of `call`.
    """
    made = [Call(model, job, code) for job in jobs]
    addresses = (c_void_p * len(made))(*(ctypes.addressof(each.struct) for each in made))
    _carry(model, jobs, made, lambda: function(addresses, len(made)))
    _pass_on()
    return [each.outcome() for each in made]


def _carry(model: Model, jobs: Sequence[Job], made: Sequence[Call], work: Callable[[], Any]) -> None:
    """Do the work of runs in C, which their own flag ends, or that of this thread, or Ctrl-C."""
    cancel = jobs[0].cancel if jobs[0].cancel is not None else cancelling()
    interruptible = threading.current_thread() is threading.main_thread() and any(_is_long(model, job) for job in jobs)
    if interruptible and jobs[0].cancel is None:
        cancel = c_int32(0)
    if cancel is not None:
        for each in made:
            each.struct.cancel = ctypes.pointer(cancel)
    if interruptible:
        _interruptible(work, cancel)
    else:
        work()


def _pass_on() -> None:
    """Pass on that the runs of this thread were ended."""
    inherited = cancelling()
    if inherited is not None and inherited.value:
        raise KeyboardInterrupt


_own = threading.local()


def cancelled_by(flag: Any) -> None:
    """Let the runs of this thread end, by KeyboardInterrupt, once ``flag``, a ``c_int32``, is not 0."""
    _own.cancel = flag


def cancelling() -> Any:
    """The flag of `cancelled_by` in this thread, or None."""
    return getattr(_own, "cancel", None)


_LONG = 2e7
"""Operations of the right-hand side from which on a run may take more than about a tenth of a second."""


def _is_long(model: Model, job: Job) -> bool:
    # A function in Python is interrupted where it stands; and it may not be made for another thread than the main one.
    steps = job.outputs * (job.timetable.apart / job.hmax + 1)
    return not model.externals and steps * (model.operations + 20) > _LONG


def _interruptible(work: Callable[[], Any], cancel: Any) -> None:
    """Do work in C that ends soon after ``cancel`` is set, and meanwhile hear Ctrl-C, as only this thread can."""
    done = threading.Event()

    def carry() -> None:
        try:
            work()
        finally:
            done.set()

    thread = threading.Thread(target=carry, name="flexarm-run")
    thread.start()
    interruption: BaseException | None = None
    while not done.is_set():
        try:
            done.wait(0.2)
        except BaseException as error:  # what the arrays of the run are in use for must end first
            interruption, cancel.value = error, 1
    thread.join()
    if interruption is not None:
        raise interruption


def _callback(calls: Calls) -> Any:
    """What C calls for the external functions; Python's lock is taken for as long as they run."""

    def call(k: int, t: float, given: Any, answer: Any) -> int:
        inputs = np.array(given[: calls.externals[k].inputs])
        outputs = calls.call(k, t, inputs)
        if outputs is None:
            return 1
        for i, value in enumerate(outputs):
            answer[i] = value
        return 0

    return _External(call)
