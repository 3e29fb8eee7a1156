"""A controller written in Python, called at sample instants."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from blocks.controllers.base import SignalBlock, clock, sample_offset
from blocks.controllers.matrices import numbered
from engine.block import option, parameter
from engine.errors import ParameterError, nearest
from engine.ports import Port

if TYPE_CHECKING:
    from engine.net import Net


class PythonController(SignalBlock):
    """Python controller: out = f(t, u) at each instant, held until the next; f is a Python function.

    ``function`` names it as ``package.module:name``, or gives it as ``name`` with ``file: controller.py``; in Python a
    callable may be given. f is called with the instant t (s) and the array u of the inputs ``in``, or ``in1``, ``in2``,
    ..., SI units, and returns a number, or one for each output ``out``, or ``out1``, ... A class is instantiated at the
    start of every run, and its instance is called, so no state passes from one run to the next. A plain
    function that keeps state elsewhere makes runs depend on each other.

    The code runs with all the rights of this program: a warning names it when it is loaded. It is loaded only where a
    scenario names it. It has no derivative and no C form, so fits by gradients and exports refuse the model.
    Outputs are 0 before the first instant.
    """

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    _callable: Any

    function = option(str, ..., "package.module:name of the function or class, or its name in the file")
    file = option(str, "", "Python file that holds it")
    inputs = option(int, 1, "number of inputs", ge=0, le=1000)
    outputs = option(int, 1, "number of outputs", ge=1, le=1000)
    unit = option(str, "V", "coherent SI unit of the outputs")
    period = parameter("s", ..., "sample period", gt=0, structural=True)
    sample_offset = sample_offset()

    def __init__(self, **values: Any) -> None:
        given: Any = values.get("function")
        self._callable = None if isinstance(given, str) or given is None else given
        if self._callable is not None:
            module, name = getattr(given, "__module__", "?"), getattr(given, "__qualname__", type(given).__qualname__)
            values["function"] = f"{module}:{name}"
        super().__init__(**values)

    def further_ports(self) -> Iterable[Port]:
        """As many inputs and outputs as asked for."""
        if self.inputs:
            yield from numbered("input", "in", self.inputs, "what the function is given")
        yield from numbered("output", "out", self.outputs, "what the function returned")

    def stamp(self, net: Net) -> None:
        function, identity = (self._callable, repr(self._callable)) if self._callable else self.load()
        inputs = [self.port(port.name) for port in self.ports.values() if port.role == "input"]
        outputs = [port for port in self.ports.values() if port.role == "output"]
        wanted = [(f"held{k + 1}", self.unit) for k in range(len(outputs))]

        def make() -> Any:
            return function() if inspect.isclass(function) else function

        held = net.external("function", clock(net, self), inputs, wanted, make, identity)
        for port, value in zip(outputs, held, strict=True):
            net.output(port.name, value, self.unit, port.doc)

    def load(self) -> tuple[Callable[..., Any], str]:
        """The named function, and a text that changes with its code.

        Raises:
            ParameterError: no such file, module or name, code that fails, or something that cannot be called.
        """
        module_name, _, name = self.function.rpartition(":")
        if bool(module_name) == bool(self.file):
            raise ParameterError(
                f"function = '{self.function}' with file = '{self.file}' does not say where to look",
                remedy="write function: package.module:name, or function: name with file: controller.py",
            )
        where = self.file or module_name
        warnings.warn(f"'{where}' is run: a PythonController of the scenario names it", RuntimeWarning, stacklevel=2)
        try:
            module = _from_file(Path(self.file)) if self.file else importlib.import_module(module_name)
        except Exception as error:
            raise ParameterError(f"'{where}' cannot be run: {type(error).__name__}: {error}") from error
        found = getattr(module, name, None)
        if found is None:
            public = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
            raise ParameterError(f"'{where}' has no '{name}'", remedy=nearest(name, public))
        if not callable(found):
            raise ParameterError(f"'{name}' in '{where}' cannot be called", remedy="name a function or a class")
        source = Path(getattr(module, "__file__", None) or "")
        code = source.read_bytes() if source.is_file() else b""
        return found, f"{where}:{name} {hashlib.sha256(code).hexdigest()[:16]}"


def _from_file(path: Path) -> Any:
    """The module of a file, run afresh."""
    spec = importlib.util.spec_from_file_location(f"flexarm_controller_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"'{path}' is not a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
