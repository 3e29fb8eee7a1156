"""The command ``flexarm``.

Exit code 0: done. 1: a problem with what the user gave, explained on stderr. 2: wrong usage.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, NoReturn, TextIO

import typer

from engine.errors import FlexarmError
from flexarm._version import version
from flexarm.commands.blocks import blocks
from flexarm.commands.check import check
from flexarm.commands.close import close
from flexarm.commands.compare import compare
from flexarm.commands.cosim import cosim
from flexarm.commands.damping import damping
from flexarm.commands.describe import describe
from flexarm.commands.diagnose import diagnose
from flexarm.commands.diagram import diagram
from flexarm.commands.export import export
from flexarm.commands.fit import fit
from flexarm.commands.linearise import linearise
from flexarm.commands.margins import margins
from flexarm.commands.plan import plan
from flexarm.commands.record import record
from flexarm.commands.run import run
from flexarm.commands.schema import schema
from flexarm.commands.sweep import sweep
from flexarm.commands.trim import trim
from flexarm.commands.uncertain import uncertain
from flexarm.console.options import AUTOMATIC
from flexarm.console.progress import Progress

COMMANDS = (
    run,
    check,
    blocks,
    schema,
    record,
    compare,
    fit,
    diagnose,
    plan,
    trim,
    linearise,
    describe,
    margins,
    uncertain,
    close,
    diagram,
    export,
    cosim,
    damping,
    sweep,
)
"""In the order in which ``flexarm --help`` lists them."""


def application(given: Sequence[str] | None = None) -> typer.Typer:
    """The command line, of typer.

    Args:
        given: the words after ``flexarm``, if they are known. typer looks at the parameters of every command that there
            is before the first one runs, which takes longer than most of them: only the one that is called is put in,
            and for the list of commands, what each is for.
    """
    made = typer.Typer(
        name="flexarm",
        help="Flexible-link robot arms and servo drives: simulate, linearise, export, compare, diagnose.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # boxes and colours: importing what draws them takes longer than all else of --help
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback()(_all)
    called = [command for command in COMMANDS if given and command.__name__ == given[0]]
    listed = given is not None and not any(word[:1] != "-" for word in given) and not completing()
    for command in COMMANDS if completing() else called or COMMANDS:
        about = (command.__doc__ or "").partition("\n\n")[0]  # as a whole; typer cuts it to a line of the list
        made.command(short_help=about)(_named(command) if listed else command)
    return made


def completing() -> bool:
    """Whether the shell asks for words, or for its script."""
    return "_FLEXARM_COMPLETE" in os.environ or any(word.endswith("-completion") for word in sys.argv)


def _named(command: Callable[..., None]) -> Callable[[], None]:
    """A command with its name and text, and without its parameters."""

    def listed() -> None:
        pass

    listed.__name__, listed.__doc__ = command.__name__, command.__doc__
    return listed


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flexarm {version()}")
        raise typer.Exit


def _all(
    wanted: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def __getattr__(name: str) -> typer.Typer:
    """``app``: the whole command line."""
    if name != "app":
        raise AttributeError(f"module 'flexarm.cli' has no attribute '{name}'")
    return application()


_FIGURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".gif", ".tif", ".tiff", ".bmp", ".eps", ".ps", ".webp")
"""Endings of pictures, those that cannot be written included: they are refused by name."""


def _with_default_plot(arguments: list[str]) -> list[str]:
    """Let ``--plot`` stand alone: what follows is its file only if it ends like a figure."""
    made = []
    for i, argument in enumerate(arguments):
        made.append(argument)
        following = arguments[i + 1] if i + 1 < len(arguments) else ""
        if argument == "--plot" and not following.lower().endswith(_FIGURES):
            made[-1] = f"--plot={AUTOMATIC}"
    return made


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    sys.stderr.write(f"warning: {message}\n")


def _give_up(error: OSError) -> NoReturn:
    """Say what the system refuses: a full disk, a name that is too long, an output that nobody reads."""
    place = f" '{error.filename}'" if error.filename else ""
    problem = FlexarmError(
        f"cannot read or write{place}: {error.strerror or error}", remedy="is there space and access?"
    )
    sys.stderr.write(f"error: {problem}\n")
    # What is left in the buffer would be tried again when the interpreter ends, with a message of its own.
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(1)


def main(arguments: list[str] | None = None) -> None:
    """The command line; ends the process with 0, 1 or 2."""
    warnings.showwarning = _show_warning
    given = list(sys.argv[1:] if arguments is None else arguments)
    os.environ["MPLBACKEND"] = "agg"  # figures become files; a backend that does not exist would end the import
    os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # it would look through all that is installed for them
    if isinstance(sys.stdout, io.TextIOWrapper):  # what the terminal's encoding does not have is written as an escape
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        try:
            with Progress(f"flexarm {' '.join(given[:2])}", spare=True):
                application(given)(args=_with_default_plot(given), prog_name="flexarm")
        finally:
            sys.stdout.flush()
    except OSError as error:
        _give_up(error)
    except FlexarmError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(1)
    except MemoryError:
        sys.stderr.write("error: the results do not fit into memory\n  record fewer signals, or use a longer step\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
