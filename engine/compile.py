"""Compile C into a loaded library, with zig's clang from the ziglang package and a cache keyed by content.

The key holds source, flags, compiler version and CPU, so a cache may be shared by processes and machines. A library is
built in a temporary folder and renamed into place, so a killed compilation leaves nothing behind. Floating-point
contraction is off: native and baseline builds of one model then give the same numbers.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from engine.errors import CompilerUnavailable

log = logging.getLogger("flexarm.compile")

FLAGS = (
    "-std=c11",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
    "-Wno-unused-function",
)
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}
_STALE = 3600.0


@functools.cache
def compiler() -> tuple[str, ...]:
    """The command that compiles C: ``$FLEXARM_CC`` if set, else zig from the ziglang package.

    Raises:
        CompilerUnavailable: neither can be found.
    """
    chosen = os.environ.get("FLEXARM_CC")
    if chosen and chosen.strip():
        try:
            return tuple(shlex.split(chosen))
        except ValueError as error:
            raise CompilerUnavailable(
                f"FLEXARM_CC is not a command: {str(error).lower()} in {chosen!r}",
                remedy="quote it as for a shell, or unset it to use zig",
            ) from None
    try:
        import ziglang
    except ImportError as error:
        raise CompilerUnavailable(
            "no C compiler: the package ziglang is not installed",
            remedy="pip install ziglang, or name a C compiler in FLEXARM_CC",
        ) from error
    name = "zig.exe" if sys.platform == "win32" else "zig"
    return (str(Path(ziglang.__file__).parent / name), "cc")


def _not_running(error: Exception) -> CompilerUnavailable:
    return CompilerUnavailable(
        f"the C compiler {' '.join(compiler())} does not run: {error}",
        remedy="unset FLEXARM_CC to use zig, or name a compiler that is installed"
        if os.environ.get("FLEXARM_CC")
        else "install it again: pip install --force-reinstall ziglang",
    )


@functools.cache
def version() -> str:
    """The compiler's version text, which is part of the cache key.

    Raises:
        CompilerUnavailable: it cannot be run.
    """
    try:
        run = subprocess.run([*compiler(), "--version"], capture_output=True, text=True, timeout=120, check=True)
    except (OSError, subprocess.SubprocessError) as error:
        raise _not_running(error) from error
    return run.stdout.strip()


@functools.cache
def _cpu() -> str:
    """Identity of the CPU that a native build is for."""
    parts = [platform.system(), platform.machine()]
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        parts += sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))})
    return "\n".join(parts)


def cache_folder() -> Path:
    """Where compiled models are kept: ``$FLEXARM_CACHE``, else the user's cache folder."""
    chosen = os.environ.get("FLEXARM_CACHE")
    if chosen and chosen.strip():
        return Path(chosen)
    return _user_cache() / "flexarm"


def _user_cache() -> Path:
    base = os.environ.get("LOCALAPPDATA") or os.environ.get("XDG_CACHE_HOME")
    return Path(base) if base else Path.home() / ".cache"


def _build(source: str, target: Path) -> None:
    """Compile into ``target`` in a folder of its own, then rename."""
    target.parent.mkdir(parents=True, exist_ok=True)
    _sweep(target.parent)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="build-") as folder:
        code, made = Path(folder) / "model.c", Path(folder) / target.name
        code.write_text(source, encoding="utf-8")
        run_compiler([*FLAGS, "-o", str(made), str(code), "-lm"], Path(folder))
        made.replace(target)


def _sweep(folder: Path) -> None:
    """Remove the files that killed compilations left behind."""
    for stale in folder.glob("build-*"):
        with contextlib.suppress(OSError):
            if time.time() - stale.stat().st_mtime > _STALE:
                shutil.rmtree(stale, ignore_errors=True)


def _scratch(folder: Path) -> dict[str, str]:
    """Where zig keeps its own files: its usual cache if that can be written, else a temporary one."""
    own = Path(os.environ.get("ZIG_GLOBAL_CACHE_DIR") or _user_cache() / "zig")
    try:
        own.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=own):
            pass
    except OSError:
        own = Path(tempfile.gettempdir()) / f"flexarm-zig-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    return {"ZIG_LOCAL_CACHE_DIR": str(folder / "zig-cache"), "ZIG_GLOBAL_CACHE_DIR": str(own)}


def run_compiler(arguments: list[str], folder: Path) -> None:
    """Run the compiler with its scratch files in ``folder``.

    Raises:
        CompilerUnavailable: it cannot be run or reports an error.
    """
    environment = os.environ | _scratch(folder)
    try:
        run = subprocess.run(
            [*compiler(), *arguments], capture_output=True, text=True, env=environment, cwd=folder, check=False
        )
    except OSError as error:
        raise _not_running(error) from error
    if run.returncode:
        raise CompilerUnavailable(
            f"the C compiler failed with code {run.returncode}:\n{run.stderr.strip()[-2000:]}",
            remedy="see FLEXARM_CC to choose another compiler",
        )


def library(source: str) -> ctypes.CDLL:
    """The loaded library of a source, compiled only if the cache has none.

    Raises:
        CompilerUnavailable: no compiler runs, or it fails.
    """
    key = hashlib.sha256("\0".join([source, *FLAGS, version(), _cpu()]).encode()).hexdigest()[:32]
    suffix = _SUFFIX.get(sys.platform, ".so")
    target = cache_folder() / f"{key}{suffix}"
    if target.exists():
        with contextlib.suppress(OSError):
            return ctypes.CDLL(str(target))
    log.info("compiling the model; the very first time fills the compiler's own cache and takes some seconds")
    try:
        _build(source, target)
    except (OSError, CompilerUnavailable) as error:
        log.info("no use of the cache %s (%s); compiling for this process only", target.parent, error)
        with tempfile.TemporaryDirectory(prefix="flexarm-", ignore_cleanup_errors=True) as folder:
            target = Path(folder) / target.name
            _build(source, target)
            return ctypes.CDLL(str(target))
    return ctypes.CDLL(str(target))


def binary(files: Mapping[str, str], arguments: Sequence[str], suffix: str) -> bytes:
    """A compiled library for any platform, as bytes; compiled only if the cache has none.

    Args:
        files: text of each source file by name; the first is compiled, the others are what it includes.
        arguments: what follows `FLAGS`, such as a target.
        suffix: of the library's file name.

    Raises:
        CompilerUnavailable: no compiler runs, or it fails.
    """
    parts = [*(part for item in files.items() for part in item), *FLAGS, *arguments, " ".join(compiler()), version()]
    target = cache_folder() / f"{hashlib.sha256(chr(0).join(parts).encode()).hexdigest()[:32]}{suffix}"
    with contextlib.suppress(OSError):
        return target.read_bytes()
    log.info("compiling for %s; the very first time for a platform takes up to some minutes", " ".join(arguments))
    with tempfile.TemporaryDirectory(prefix="flexarm-", ignore_cleanup_errors=True) as name:
        folder, main = Path(name), next(iter(files))
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        made = folder / f"library{suffix}"
        run_compiler([*FLAGS, *arguments, "-o", made.name, main, "-lm"], folder)
        content = made.read_bytes()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=target.parent, delete=False) as file_made:
            file_made.write(content)
        Path(file_made.name).replace(target)
    except OSError as error:
        log.info("the cache %s cannot be written (%s)", target.parent, error)
    return content
