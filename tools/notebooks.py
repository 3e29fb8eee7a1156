"""Execute notebooks and write them as Markdown pages with their figures."""

from __future__ import annotations

import base64
import os
import re
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "notebooks"
COLOURS = re.compile(r"\x1b\[[0-9;]*m")


def execute(path: Path, timeout: int = 300) -> Any:
    """A notebook with the outputs of its cells, run in its own folder.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed; the message holds cell and traceback.
    """
    import nbformat
    from nbclient import NotebookClient
    from traitlets.config import Config

    notebook: Any = nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)  # type: ignore[no-untyped-call]
    with tempfile.TemporaryDirectory() as folder:
        settings = Config()
        if os.name != "nt":
            # Where it can, the kernel listens on files of this user, not on ports of the machine.
            settings.KernelManager.transport = "ipc"
            settings.KernelManager.ip = f"{folder}/kernel"
        client = NotebookClient(
            notebook,
            config=settings,
            kernel_name="python3",
            timeout=timeout,
            resources={"metadata": {"path": str(path.parent)}},
        )
        # Figures go into the notebook, whatever the caller's backend is.
        return client.execute(env=os.environ | {"MPLBACKEND": "module://matplotlib_inline.backend_inline"})


def page(notebook: Any, name: str) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and its figures by file name.

    Args:
        notebook: with outputs.
        name: stem of the figures' names.
    """
    parts: list[str] = []
    figures: dict[str, bytes] = {}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
        elif cell.cell_type == "code":
            parts.append(f"```python\n{cell.source}\n```")
            parts += [shown for output in cell.outputs if (shown := _output(output, name, figures))]
    return "\n\n".join(parts) + "\n", figures


def _output(output: Any, name: str, figures: dict[str, bytes]) -> str:
    if output.output_type == "stream":
        return f"```text\n{COLOURS.sub('', output.text).rstrip()}\n```" if output.name == "stdout" else ""
    data = output.get("data", {})
    for kind, suffix in (("image/png", "png"), ("image/svg+xml", "svg")):
        if kind in data:
            file = f"{name}-{len(figures) + 1}.{suffix}"
            raw = data[kind]
            figures[file] = base64.b64decode(raw) if suffix == "png" else raw.encode()
            return f"![Figure {len(figures)}]({file})"
    return f"```text\n{data['text/plain']}\n```" if "text/plain" in data else ""
