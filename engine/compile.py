"""Compile C into a loaded library, with zig's clang from the ziglang package and a cache keyed by content.

The key holds source, flags, compiler version and CPU, so a cache may be shared by processes and machines. A library is
built in a temporary folder and renamed into place, so a killed compilation leaves nothing behind; `engine.cache` tells
what is damaged. Floating-point contraction is off: native and baseline builds of one model then give the same numbers.
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
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from engine import cache
from engine.errors import CompilerUnavailable

log = logging.getLogger("flexarm.compile")

FLAGS = (
    "-std=c11",
    "-O2",
    "-g0",  # zig's default describes lines and names to a debugger: a fifth of the time, and three quarters of the file
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
    "-Wno-unused-function",
)
_LARGE = 150_000
"""Characters of C from which on the search for vector instructions takes longer than it can save."""
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


def _not_running(error: object) -> CompilerUnavailable:
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
    kept = _kept_version()
    if kept is not None and (known := cache.opened(kept)) is not None:
        return known.decode()
    with _temporary() as folder:
        run = _started(["--version"], folder)
    if run.returncode:
        raise _not_running(run.stderr.strip()[-500:] or f"it ends with code {run.returncode}")
    said = run.stdout.strip()
    if kept is not None:
        with contextlib.suppress(OSError):
            cache.put(kept, said.encode())
    return said


def _kept_version() -> Path | None:
    """The file that holds the version of zig as it is installed; None for another compiler, which may be a wrapper."""
    if os.environ.get("FLEXARM_CC"):
        return None
    try:
        program = Path(compiler()[0])
        found = program.stat()
        what = hashlib.sha256(f"{program} {found.st_mtime_ns} {found.st_size}".encode()).hexdigest()[:16]
        return cache.folder() / f"compiler-{what}.txt"
    except OSError:
        return None


_NO_LOOPS, _NO_LINES = "-fno-vectorize", "-fno-slp-vectorize"
"""Without the search for vector instructions in loops, and in lines that follow one another; only clang knows these."""


def flags(source: str, *, in_lines: bool = False) -> tuple[str, ...]:
    """Flags for a source. What is left out beside `FLAGS`, which only clang knows, changes no result.

    Lines that happen to be alike wait for one another in a vector: runs take up to 9 % less time without. Tangents are
    vectors in the source already; theirs take less if loops are left as they are. A large source has neither.

    Args:
        source: C.
        in_lines: whether vectors are looked for in lines rather than loops.
    """
    if "clang" not in version():
        return FLAGS
    if len(source) > _LARGE:
        return (*FLAGS, _NO_LOOPS, _NO_LINES)
    if "#define FA_BYTECODE" in source:
        return (*FLAGS, _NO_LOOPS, _NO_LINES)
    return (*FLAGS, _NO_LOOPS if in_lines else _NO_LINES)


@functools.cache
def _cpu() -> str:
    """Identity of the CPU that a native build is for."""
    parts = [platform.system(), platform.machine()]
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        parts += sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))})
    return "\n".join(parts)


def _build(source: str, target: Path, chosen: Sequence[str]) -> None:
    """Compile into ``target``, sealed, in a folder of its own, then rename."""
    target.parent.mkdir(parents=True, exist_ok=True)
    _sweep(target.parent)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="build-", ignore_cleanup_errors=True) as folder:
        code, made = Path(folder) / "model.c", Path(folder) / target.name
        code.write_text(source, encoding="utf-8")
        run_compiler([*chosen, "-o", str(made), str(code), "-lm"], Path(folder))
        made.write_bytes(cache.sealed(made.read_bytes()))
        made.replace(target)


def _sweep(folder: Path) -> None:
    """Remove the files that killed compilations left behind."""
    for stale in folder.glob("build-*"):
        with contextlib.suppress(OSError):
            if time.time() - stale.stat().st_mtime > _STALE:
                shutil.rmtree(stale, ignore_errors=True)


def _scratch(folder: Path) -> dict[str, str]:
    """Where zig keeps its own files: its usual cache if that can be written, else a private temporary one.

    Raises:
        CompilerUnavailable: neither can be used.
    """
    chosen, user = os.environ.get("ZIG_GLOBAL_CACHE_DIR"), cache.user_folder()
    own = Path(chosen) if chosen else user / "zig" if user else None
    if own is None or not cache.writable(own):
        own = cache.private("flexarm-zig")
    return {"ZIG_LOCAL_CACHE_DIR": str(folder / "zig-cache"), "ZIG_GLOBAL_CACHE_DIR": str(own)}


def _started(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the compiler to its end, with its scratch files in ``folder``."""
    environment = os.environ | _scratch(folder)
    try:
        return subprocess.run(
            [*compiler(), *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            env=environment,
            cwd=folder,
            check=False,
        )
    except (OSError, ValueError) as error:
        raise _not_running(error) from error


def run_compiler(arguments: list[str], folder: Path) -> None:
    """Run the compiler with its scratch files in ``folder``.

    Raises:
        CompilerUnavailable: it cannot be run or reports an error.
    """
    run = _started(arguments, folder)
    if run.returncode:
        raise CompilerUnavailable(
            f"the C compiler failed with code {run.returncode}:\n{run.stderr.strip()[-2000:]}",
            remedy="see FLEXARM_CC to choose another compiler",
        )


def _library_name(source: str, chosen: Sequence[str]) -> str:
    key = hashlib.sha256("\0".join([source, *chosen, version(), _cpu()]).encode()).hexdigest()[:32]
    return f"{key}{_SUFFIX.get(sys.platform, '.so')}"


def known(source: str, *, in_lines: bool = False) -> bool:
    """Whether the cache has the library of a source; see `library`.

    Raises:
        CompilerUnavailable: no compiler runs.
    """
    try:
        return (cache.folder() / _library_name(source, flags(source, in_lines=in_lines))).is_file()
    except OSError:
        return False


def library(source: str, *, in_lines: bool = False) -> ctypes.CDLL:
    """The loaded library of a source, compiled only if the cache has none that is sound.

    Args:
        source: C.
        in_lines: see `flags`.

    Raises:
        CompilerUnavailable: no compiler runs, or it fails.
    """
    chosen = flags(source, in_lines=in_lines)
    name = _library_name(source, chosen)
    try:
        target = cache.folder() / name
        if cache.opened(target) is not None:
            with contextlib.suppress(OSError):
                return ctypes.CDLL(str(target))
        log.info("compiling the model; the very first time fills the compiler's own cache and takes some seconds")
        _build(source, target, chosen)
        return ctypes.CDLL(str(target))
    except (OSError, CompilerUnavailable) as error:
        log.info("no use of the cache (%s); compiling for this process only", error)
        with _temporary() as folder:
            target = folder / name
            _build(source, target, chosen)
            return ctypes.CDLL(str(target))


@contextlib.contextmanager
def _temporary() -> Iterator[Path]:
    """A folder for compiling.

    Raises:
        CompilerUnavailable: the system's temporary folder is full or cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="flexarm-", ignore_cleanup_errors=True) as name:
            yield Path(name)
    except OSError as error:
        raise CompilerUnavailable(
            f"no model can be compiled in the folder '{tempfile.gettempdir()}': {error.strerror or error}",
            remedy="make room in it, or name another one in TMPDIR",
        ) from error


def binary(files: Mapping[str, str], arguments: Sequence[str], suffix: str) -> bytes:
    """A compiled library for any platform, as bytes; compiled only if the cache has none.

    Args:
        files: text of each source file by name; the first is compiled, the others are what it includes.
        arguments: what follows `FLAGS`, such as a target.
        suffix: of the library's file name.

    Raises:
        CompilerUnavailable: no compiler runs, or it fails.
    """
    chosen = flags(next(iter(files.values())))
    parts = [*(part for item in files.items() for part in item), *chosen, *arguments, " ".join(compiler()), version()]
    name = f"{hashlib.sha256(chr(0).join(parts).encode()).hexdigest()[:32]}{suffix}"
    with contextlib.suppress(CompilerUnavailable):
        kept = cache.opened(cache.folder() / name)
        if kept is not None:
            return kept
    log.info("compiling for %s; the very first time for a platform takes up to some minutes", " ".join(arguments))
    with _temporary() as folder:
        main = next(iter(files))
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        made = folder / f"library{suffix}"
        run_compiler([*chosen, *arguments, "-o", made.name, main, "-lm"], folder)
        content = made.read_bytes()
    _remember(content, name)
    return content


def _remember(content: bytes, name: str) -> None:
    """Put a compiled library into the cache, if that can be written."""
    try:
        folder = cache.folder()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix="build-", ignore_cleanup_errors=True) as scratch:
            made = Path(scratch) / name
            made.write_bytes(cache.sealed(content))
            made.replace(folder / name)
    except (OSError, CompilerUnavailable) as error:
        log.info("the cache cannot be written (%s)", error)
