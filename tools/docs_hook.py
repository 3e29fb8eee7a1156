"""Hooks of the mkdocs build: add the reference, the gallery's figures and the executed notebooks.

Nothing of it is kept in the repository. Figures and notebooks take some seconds, and so they are kept in
``.docs-cache`` until a file that they depend on changes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from engine.files import writing
from tools import bibliography, gallery, notebooks, reference, rules

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / ".docs-cache"
SOURCES = ("engine", "blocks", "scenarios", "fmu", "diagnosis", "flexarm")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages that there are in the place of patterns in the navigation, such as ``adr/*.md``."""
    config.nav = _expanded(config.nav, Path(config.docs_dir))
    return config


def _expanded(entry: Any, docs: Path) -> Any:
    if isinstance(entry, dict):
        return {title: _expanded(below, docs) for title, below in entry.items()}
    if not isinstance(entry, list):
        return entry
    made: list[Any] = []
    for item in entry:
        if isinstance(item, str) and "*" in item:
            made += [path.relative_to(docs).as_posix() for path in sorted(docs.glob(item))]
        else:
            made.append(_expanded(item, docs))
    return made


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated files; notebooks themselves are copied like any other file in ``docs``."""
    made: dict[str, str | bytes] = {**reference.pages(), "reference/diagnosis-rules.md": rules.page()}
    made[bibliography.PAGE] = bibliography.page()
    stamp = _stamp()
    for name, draw in gallery.FIGURES.items():
        made[f"figures/gallery/{name}"] = _kept(f"{stamp}-{name}", draw)
    for path in sorted(notebooks.FOLDER.glob("*.ipynb")):
        made |= _notebook(path, stamp)
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    for old in CACHE.iterdir():
        if not old.name.startswith((stamp, ".")):
            old.unlink(missing_ok=True)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let citations such as [Mohan 2010, eq. 7c] lead to the bibliography."""
    if page.file.src_uri == bibliography.PAGE:
        return markdown
    return bibliography.linked(markdown, "../" * page.file.src_uri.count("/"))


def _notebook(path: Path, stamp: str) -> Iterator[tuple[str, str | bytes]]:
    """Page and figures of a notebook."""

    def run() -> bytes:
        text, figures = notebooks.page(notebooks.execute(path), path.stem)
        return json.dumps({"text": text, "figures": {name: data.hex() for name, data in figures.items()}}).encode()

    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    found = json.loads(_kept(f"{stamp}-{digest}-{path.stem}.json", run))
    link = f"\n[This page as a notebook]({path.name})\n"
    yield f"notebooks/{path.stem}.md", found["text"] + link
    for name, data in found["figures"].items():
        yield f"notebooks/{name}", bytes.fromhex(data)


def _kept(name: str, make: Callable[[], bytes]) -> bytes:
    """A file of the cache; made if it is not there."""
    path = CACHE / name
    if not path.exists():
        CACHE.mkdir(exist_ok=True)
        content = make()
        with writing(path, (path.suffix,)) as temporary:
            temporary.write_bytes(content)
    return path.read_bytes()


def _stamp() -> str:
    """Digest of everything that a figure can depend on."""
    digest = hashlib.sha256()
    folders = [ROOT / name for name in (*SOURCES, "tools", "docs/gallery", "docs/tutorial/data")]
    for path in sorted(
        p for folder in folders for p in folder.rglob("*") if p.suffix in (".py", ".c", ".h", ".yaml", ".csv")
    ):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]
