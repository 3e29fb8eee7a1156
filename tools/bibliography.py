"""Works that the repository cites: read from ``docs/references.bib``, listed on a page, linked and checked.

A citation stands in square brackets: the first author's name and the year, then the place: ``[Mohan 2010, eq. 7c]``.
Works without a date have ``n.d.``, several are parted by semicolons: ``[Bouc 1967; Wen 1976]``. The label without
spaces, dots and hyphens is the key in ``docs/references.bib``. ``python -m tools.bibliography`` checks every file that
git knows and prints what is wrong.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIB = ROOT / "docs" / "references.bib"
PAGE = "reference/bibliography.md"

_LABEL = r"[A-Z][\w-]+(?:\s+[A-Z]\.)?\s+(?:n\.d\.|(?:18|19|20)\d\d)"
_PLACE = r"(?:,\s+[^\[\];]+)?"
CITATION = re.compile(rf"(?<![\w\]])\[({_LABEL}{_PLACE}(?:;\s+(?:# )?{_LABEL}{_PLACE})*)\](?!\()")
"""A citation in text; group 1 is what the brackets hold."""

_ONE = re.compile(rf"({_LABEL})({_PLACE})")
_BANNED = re.compile(r"referee|\bpapers?\s+00\d|\(checks? \d+", re.IGNORECASE)
_OTHER = re.compile(
    r"\[[A-Z][\w-]+(?: [A-Z]\.)?,? ?(?:n\.d|(?:18|19|20)\d\d\b)|"
    r"\([A-Z][\w-]+(?:, [A-Z][\w-]+)*(?:,? and [A-Z][\w-]+| et al\.)?,? (?:18|19|20)\d\d\)"
)
"""What looks like a citation and has not its form, or stands in round brackets."""

_ENTRY = re.compile(r"@(\w+)\{(\w+),\n(.*?)\n\}", re.DOTALL)
_FIELD = re.compile(r"  (\w+) = \{(.*)\},")
_ACCENTS = {r"{\'e}": "é", r"{\'a}": "á", r"{\AA}": "Å", r"{\"o}": "ö", r"{\"a}": "ä"}

ABOUT = ("tools/bibliography.py", "tests/docs/test_bibliography.py")
"""Files that are about citations and hold wrong ones."""

_TEXT = {".py", ".md", ".yaml", ".c", ".h", ".csv", ".ipynb", ".toml", ".cff", ""}


@dataclass(frozen=True)
class Work:
    """A work of the bibliography.

    Attributes:
        key: such as ``Mohan2010``.
        kind: of BibTeX, such as ``article``.
        fields: by name; accents are plain letters.
    """

    key: str
    kind: str
    fields: dict[str, str]

    @property
    def authors(self) -> str:
        """``A. Mohan, S. P. Singh and S. K. Saha``; empty if none is known."""
        names = [n for n in self.fields.get("author", "").split(" and ") if n]
        turned = [" ".join(reversed(name.split(", ", 1))) for name in names]
        return " and ".join([", ".join(turned[:-1]), turned[-1]] if len(turned) > 1 else turned)

    @property
    def text(self) -> str:
        """The entry as a line of Markdown."""
        f = self.fields
        where = f.get("journal") or f.get("booktitle") or f.get("school") or f.get("institution") or f.get("publisher")
        number = f.get("volume", "") + (f"({f['number']})" if "number" in f else "")
        parts = [self.authors, f"*{f['title']}*", " ".join(p for p in (where, number) if p), f.get("howpublished", "")]
        parts += [f.get("pages", "").replace("--", " to "), f.get("year", "n.d.")]
        parts += [f"{f['archiveprefix']} {f['eprint']}"] if "eprint" in f else []
        parts += [f"doi {f['doi']}"] if "doi" in f else []
        note = f" {f['note']}." if "note" in f else ""
        return ", ".join(part for part in parts if part) + "." + note


def works(path: Path = BIB) -> dict[str, Work]:
    """Every work by key, in the order of the file.

    Raises:
        ValueError: an entry that is not one field a line, or a key that stands twice.
    """
    text = path.read_text(encoding="utf-8")
    found: dict[str, Work] = {}
    for kind, key, body in _ENTRY.findall(text):
        fields = {}
        for line in body.split("\n"):
            field = _FIELD.fullmatch(line)
            if field is None:
                raise ValueError(f"{path.name}, {key}: '{line.strip()}' is not one field, '  name = {{value}},'")
            value = field[2]
            for written, letter in _ACCENTS.items():
                value = value.replace(written, letter)
            fields[field[1]] = value
        if key in found:
            raise ValueError(f"{path.name}: '{key}' stands twice")
        found[key] = Work(key, kind, fields)
    if len(found) != text.count("\n@"):
        raise ValueError(f"{path.name}: an entry does not end with '}}' on a line of its own")
    return found


def key(label: str) -> str:
    """The key of a label: ``Gao X. n.d.`` is ``GaoXnd``."""
    return re.sub(r"[\s.-]", "", label)


def cited(text: str) -> Iterator[tuple[int, str]]:
    """Line (from 1) and key of every citation in a text."""
    for match in CITATION.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        for label, _ in _ONE.findall(match[1]):
            yield line, key(label)


def problems(name: str, text: str, known: dict[str, Work]) -> Iterator[str]:
    """What is wrong in a file: keys that the bibliography lacks, and mentions of pages that nobody outside has."""
    for line, cites in cited(text):
        if cites not in known:
            yield f"{name}:{line}: '{cites}' is not in docs/references.bib"
    proper = {match.start() for match in CITATION.finditer(text)}
    for match in _OTHER.finditer(text):
        if match.start() not in proper:
            line = text.count("\n", 0, match.start()) + 1
            yield f"{name}:{line}: write '{match[0]}...' as a citation, such as [Mohan 2010, eq. 7c]"
    for match in _BANNED.finditer(text):
        number = text.count("\n", 0, match.start()) + 1
        yield f"{name}:{number}: cite author and equation: {text.splitlines()[number - 1].strip()[:100]}"


def files() -> Iterator[tuple[str, str]]:
    """Name and content of every text file that git knows."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in listed.split("\0"):
        path = ROOT / name
        if name and path.suffix in _TEXT and path.is_file():
            yield name, path.read_text(encoding="utf-8")


def faults() -> list[str]:
    """What is wrong in every file that git knows, without `ABOUT`."""
    known = works()
    checked = ((name, text) for name, text in files() if name not in ABOUT)
    return [line for name, text in checked for line in problems(name, text, known)]


def page() -> str:
    """The bibliography as Markdown."""
    lines = ["# Bibliography", "", "Works that the library cites, from `docs/references.bib`.", ""]
    for work in sorted(works().values(), key=lambda w: w.key.lower()):
        lines += [f"### {label(work)}", "", work.text, ""]
    return "\n".join(lines)


def label(work: Work) -> str:
    """How a work is cited: ``Mohan 2010``, ``Gao X. n.d.``."""
    for pattern, made in ((r"(.+?)(\d{4})", r"\1 \2"), (r"(.+?)([A-Z])nd", r"\1 \2. n.d."), (r"(.+)nd", r"\1 n.d.")):
        if re.fullmatch(pattern, work.key):
            return re.sub(f"^{pattern}$", made, work.key).replace("Onelink", "One-link")
    return work.key


def linked(markdown: str, up: str) -> str:
    """Markdown whose citations lead to the bibliography.

    Args:
        markdown: a page; brackets may be escaped.
        up: the way from the page to the root of the documentation, such as ``../``.
    """

    def link(match: re.Match[str]) -> str:
        anchor = re.sub(r"\s+", "-", match[1].lower().replace(".", ""))
        return f"[{match[1]}]({up}{PAGE}#{anchor}){match[2]}"

    plain = re.sub(rf"\\\[({_LABEL}[^\[\]]*)\\\]", r"[\1]", markdown)
    parts = re.split(r"(```.*?```|`[^`\n]*`|^    .*$)", plain, flags=re.DOTALL | re.MULTILINE)
    parts[::2] = [CITATION.sub(lambda m: "\\[" + _ONE.sub(link, m[1]) + "\\]", part) for part in parts[::2]]
    return "".join(parts)


def main() -> int:
    """Print what is wrong; the exit code is 1 if anything is."""
    found = faults()
    print("\n".join(found) or f"{len(works())} works; every citation is among them")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
