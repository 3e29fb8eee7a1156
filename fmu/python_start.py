"""Starts the Python process of an FMU: the FMU's binary runs this file, which is ``start.py`` of its resources.

It sees whether this Python has the flexarm that made the FMU, and says why not to the binary, which then tries another
one. So it needs nothing but the standard library, and is written for any Python 3 that may be found.
"""

import json
import os
import struct
import sys

HELLO = b"flexarm\0"
OK, ERROR = 0, 3


def main() -> None:
    """Take the pipes from standard input and output, and answer requests or say why not."""
    if sys.platform != "win32":
        os.closerange(3, 1 << 16)  # what the importer had open is not ours
    requests = os.dup(0)
    with open(os.devnull, "rb") as nothing:  # noqa: PTH123
        os.dup2(nothing.fileno(), 0)
    answers = requests
    if sys.platform == "win32":
        import msvcrt

        answers = os.dup(1)
        os.dup2(2, 1)
        for pipe in (requests, answers):
            msvcrt.setmode(pipe, os.O_BINARY)
    folder = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120
    sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry) != folder]  # noqa: PTH100
    reason = unfit(folder)
    if reason:
        text = "{} ({})".format(reason, sys.executable).encode("utf-8", "replace")  # noqa: UP032
        os.write(answers, HELLO + struct.pack("=III", ERROR, 0, len(text)) + text)
        return
    from fmu.python_child import serve

    os.write(answers, HELLO + struct.pack("=III", OK, 0, 0))
    serve(requests, answers, folder)


def unfit(folder: str) -> str:
    """Why this Python cannot run the FMU; empty if it can."""
    with open(os.path.join(folder, "recipe.json"), "rb") as file:  # noqa: PTH118, PTH123
        wanted = json.loads(file.read().decode("utf-8"))["python"]
    if sys.version_info < tuple(wanted["oldest"]):
        return "it is Python {}.{}".format(*sys.version_info)
    if sys.executable == wanted["executable"] and wanted["folder"] not in sys.path:
        sys.path.insert(1, wanted["folder"])  # flexarm was run from a folder of its own, not installed
    from importlib import metadata

    try:
        found = metadata.version("flexarm")
    except metadata.PackageNotFoundError:
        found = ""
    if found != wanted["flexarm"]:
        return "it has flexarm {}".format(found) if found else "it has no flexarm"  # noqa: UP032
    try:
        import fmu.python_child  # noqa: F401
    except Exception as error:
        return "flexarm cannot be imported: {}: {}".format(type(error).__name__, error)  # noqa: UP032
    return ""


if __name__ == "__main__":
    main()
