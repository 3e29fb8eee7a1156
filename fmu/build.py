"""Binaries for each platform, cross-compiled by zig and cached by content."""

from __future__ import annotations

import platform as machine
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.compile import binary, compiler
from engine.errors import CompilerUnavailable, FlexarmError, nearest


@dataclass(frozen=True)
class Platform:
    """Where a binary runs.

    Attributes:
        folder: in ``binaries`` of an FMI 2 FMU.
        folder3: in ``binaries`` of an FMI 3 FMU.
        suffix: of the library.
        target: zig's name for it.
    """

    folder: str
    folder3: str
    suffix: str
    target: str


PLATFORMS = {
    "linux64": Platform("linux64", "x86_64-linux", ".so", "x86_64-linux-gnu.2.17"),
    "win64": Platform("win64", "x86_64-windows", ".dll", "x86_64-windows-gnu"),
    "darwin64": Platform("darwin64", "x86_64-darwin", ".dylib", "x86_64-macos"),
    "darwin-aarch64": Platform("aarch64-darwin", "aarch64-darwin", ".dylib", "aarch64-macos"),
    "aarch64": Platform("aarch64-linux", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
}
DEFAULT = ("linux64", "win64")
_PROBE = Path(__file__).parent / "heads" / "probe_windows.c"


def check(platforms: Sequence[str]) -> tuple[str, ...]:
    """The platforms, each once.

    Raises:
        FlexarmError: none is given, or one is unknown.
    """
    for name in platforms:
        if name not in PLATFORMS:
            raise FlexarmError(f"unknown platform '{name}'", remedy=nearest(name, PLATFORMS))
    if not platforms:
        raise FlexarmError("no platform is given", remedy=f"allowed: {', '.join(PLATFORMS)}")
    return tuple(dict.fromkeys(platforms))


def _is_zig() -> bool:
    return any(Path(part).stem.lower().startswith(("zig", "python-zig")) or part == "ziglang" for part in compiler())


def _own() -> str:
    """The platform this process runs on, if it is one of ours."""
    name = {"linux": "linux64", "win32": "win64", "darwin": "darwin64"}.get(sys.platform, "")
    if machine.machine().lower() in ("x86_64", "amd64"):
        return name
    return {"linux64": "aarch64", "darwin64": "darwin-aarch64"}.get(name, "")


def library(files: dict[str, str], platform: str) -> bytes:
    """The compiled FMU for a platform.

    Args:
        files: sources by name, the one to compile first.
        platform: a key of `PLATFORMS`.

    Raises:
        CompilerUnavailable: no compiler runs, it fails, or it cannot compile for that platform.
    """
    chosen = PLATFORMS[platform]
    if _is_zig():
        arguments = ["-target", chosen.target, "-mcpu=baseline", "-s"]
        if platform == "win64":
            # The compiler's runtime, which comes whole, is four times the model; the system has what is used of it.
            files = files | {_PROBE.name: _PROBE.read_text(encoding="utf-8")}
            arguments += ["-rtlib=none", _PROBE.name]
    elif platform == _own():
        arguments = ["-s"]
    else:
        raise CompilerUnavailable(
            f"the C compiler {' '.join(compiler())} does not compile for {platform}",
            remedy=f"unset FLEXARM_CC to use zig, or export for {_own() or 'this machine'} only",
        )
    return binary(files, arguments, chosen.suffix)
