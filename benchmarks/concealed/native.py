"""The C simulator: compiled once, called through ctypes. Own code throughout, so that agreement with flexarm counts."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import os
import shlex
import shutil
import sys
import tempfile
from pathlib import Path
from subprocess import run

SOURCE = Path(__file__).with_name("simulator.c")
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")

FRICTION, CONTACT, CUBIC, DRAG, GRAVITY, RIPPLE, VIBRATION, BOUC_WEN = range(8)
WARM_UP, SERIES, STRANDS, END_STOP, OILED, MESH, MESH_INPUT = range(8, 15)
"""Kinds of elements, in the order of the C enum."""

WIDTH = 12
"""Parameters of an element, PARAMETERS in C."""

_pointer = ctypes.POINTER(ctypes.c_double)
_INTEGERS = ("states", "forces", "elements", "outputs", "modes", "substeps", "samples", "closed")
_LINEAR = ("phi", "gamma", "phi_half", "gamma_half", "C", "D")
_ELEMENT = ("kind", "sense", "rate", "parameter", "load", "load_feed")
_WHIRL = ("whirl_speed", "whirl_a", "whirl_b", "whirl_amplitude", "whirl_rate", "whirl_H")
_RECORDING = ("input", "turning", "sensor", "series", "drift", "noise", "quantum", "loop", "reference", "x0")
_RESULT = ("command", "clean", "measured", "trace")
_ARRAYS = (*_LINEAR, *_ELEMENT, *_WHIRL, *_RECORDING, *_RESULT)


class Plan(ctypes.Structure):
    """The C struct of the same name."""

    _fields_ = (
        [(name, ctypes.c_int) for name in _INTEGERS]
        + [("step", ctypes.c_double), ("start", ctypes.c_double)]
        + [(name, ctypes.POINTER(ctypes.c_int) if name == "kind" else _pointer) for name in _ARRAYS]
    )


def compiler() -> list[str]:
    """The command that compiles C: $CC, else cc, gcc or clang, else zig from the ziglang package."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise RuntimeError("no C compiler: set CC, install gcc or clang, or the package ziglang")


def _folder() -> Path:
    """Where the library is kept: the user's cache, or a temporary folder if that cannot be written."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "flexarm-concealed"
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            return base
    except OSError:
        return Path(tempfile.mkdtemp(prefix="flexarm-concealed-"))


@functools.cache
def library() -> ctypes.CDLL:
    """The simulator, compiled if need be."""
    command = [*compiler(), *FLAGS]
    key = hashlib.sha256(" ".join(command).encode() + SOURCE.read_bytes()).hexdigest()[:20]
    folder = _folder()
    target = folder / f"simulator-{key}.so"
    if not target.exists():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            made = Path(scratch) / target.name
            done = run([*command, "-o", str(made), str(SOURCE), "-lm"], capture_output=True, text=True, check=False)
            if done.returncode:
                raise RuntimeError(f"the truth simulator does not compile:\n{done.stderr}")
            made.replace(target)
    loaded = ctypes.CDLL(str(target))
    loaded.concealed_simulate.argtypes = [ctypes.POINTER(Plan)]
    return loaded
