"""The packages beside ``flexarm`` have common names: see that it is ours that are imported, or say what is in the way.

See docs/adr/0016-top-level-names.md. Called once, when `flexarm` is imported.
"""

from __future__ import annotations

import os
import sys
import warnings
from importlib.machinery import PathFinder

OURS = ("engine", "blocks", "scenarios", "fmu", "diagnosis")
MARK = "Part of flexarm."
"""Stands in the docstring of each of our packages: another distribution's ``__init__.py`` in its place has none."""

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120 (pathlib would cost more)


def claim() -> None:
    """Make sure that the names in `OURS` mean the packages beside this one.

    A file or folder of the user's that has one of these names and comes first on the path is passed over, with a
    warning where the program is the user's own.

    Raises:
        ImportError: one of the names was imported from elsewhere before, or is overwritten where we are installed.
    """
    if _is_our_command():
        _working_folder_last()
    for name in OURS:
        loaded = sys.modules.get(name)
        if loaded is not None and not _ours(name, getattr(loaded, "__file__", None)):
            raise ImportError(_imported_before(name, getattr(loaded, "__file__", None) or "a folder of that name"))
        if not _whole(name):
            raise ImportError(_overwritten(name))
    found = ((name, PathFinder.find_spec(name)) for name in OURS if name not in sys.modules)
    others = [spec.origin or name for name, spec in found if spec is not None and not _ours(name, spec.origin)]
    if others:
        sys.path.insert(0, ROOT)
        several = "have names" if len(others) > 1 else "has the name"
        warnings.warn(
            f"{', '.join(others)} {several} of packages of flexarm, which are imported in their place: rename "
            f"{'them' if len(others) > 1 else 'it'}",
            RuntimeWarning,
            stacklevel=3,
        )


def _ours(name: str, file: str | None) -> bool:
    return file is not None and os.path.realpath(file) == os.path.realpath(_init(name))


def _init(name: str) -> str:
    return os.path.join(ROOT, name, "__init__.py")  # noqa: PTH118


def _whole(name: str) -> bool:
    try:
        with open(_init(name), encoding="utf-8") as file:  # noqa: PTH123
            return MARK in file.read(2000)
    except (OSError, UnicodeDecodeError):
        return False


def _is_our_command() -> bool:
    """Whether this process is ``python -m flexarm`` or ``python -m flexarm.something``."""
    if sys.argv[:1] != ["-m"]:  # what it is while the module to run is being looked for
        return False
    given = sys.orig_argv
    words = [given[k + 1] if word == "-m" else word[2:] for k, word in enumerate(given[:-1]) if word[:2] == "-m"]
    words += [given[-1][2:]] if given[-1][:2] == "-m" else []
    return any(word.partition(".")[0] == "flexarm" for word in words[:1])


def _working_folder_last() -> None:
    """``python -m`` puts the working folder first on the path, where any script of the user's would be in the way."""
    first = sys.path[0] if sys.path else ROOT
    if os.path.realpath(first) == os.path.realpath(os.getcwd()) != os.path.realpath(ROOT):  # noqa: PTH109
        sys.path.append(sys.path.pop(0))


def _imported_before(name: str, file: str) -> str:
    return (
        f"flexarm needs its own package '{name}', and '{name}' was imported before from {file}\n"
        f"  rename {_kind(file)}{_distribution(name, file)}"
    )


def _kind(file: str) -> str:
    return "the folder of that file" if os.path.basename(file) == "__init__.py" else "that file"  # noqa: PTH119


def _distribution(name: str, file: str) -> str:
    """What to do instead where the package belongs to another distribution."""
    if "site-packages" not in file and "dist-packages" not in file:
        return ""
    from importlib import metadata

    owners = [owner for owner in metadata.packages_distributions().get(name, ()) if owner != "flexarm"]
    whose = f" of the distribution '{owners[0]}'" if owners else ""
    return f"; if it is{whose} a library that you need, give flexarm a virtual environment of its own"


def _overwritten(name: str) -> str:
    from importlib import metadata

    owners = [owner for owner in metadata.packages_distributions().get(name, ()) if owner != "flexarm"]
    by = f"the distribution '{owners[0]}'" if owners else "another distribution"
    return (
        f"{_init(name)} is not flexarm's: {by} has a package of the same name and was installed over it\n"
        f"  give flexarm a virtual environment of its own, or uninstall the other and reinstall flexarm"
    )
