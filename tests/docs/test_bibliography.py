"""Every citation in the repository names a work of ``docs/references.bib``; nothing cites a page that is not here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tools import bibliography

KNOWN = bibliography.works()


def test_every_citation_is_in_the_bibliography() -> None:
    found = bibliography.faults()
    assert not found, "\n".join(found)


def test_every_work_is_cited() -> None:
    cited = {
        key
        for name, text in bibliography.files()
        if name not in bibliography.ABOUT
        for _, key in bibliography.cited(text)
    }
    assert set(KNOWN) == cited


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("as in [Nobody 1999, eq. 3]", "x.py:1: 'Nobody1999' is not in docs/references.bib"),
        ("one\n[Mohan 2010; Noone n.d.]", "x.py:2: 'Noonend' is not in docs/references.bib"),
        ("a\nsee the referee's notes", "x.py:2: cite author and equation: see the referee's notes"),
        ("Papers 001 and 002", "x.py:1: cite author and equation"),
        ("damage (checks 12, 13)", "x.py:1: cite author and equation"),
        ("after (Transtrum and Sethna 2012)", "x.py:1: write '(Transtrum and Sethna 2012)...' as a citation"),
        ("[Mohan, 2010]", "x.py:1: write '[Mohan, 2010...' as a citation"),
        ("[Gao X. n.d, eq. 3]", "x.py:1: write '[Gao X. n.d...' as a citation"),
    ],
)
def test_what_is_refused(text: str, said: str) -> None:
    found = list(bibliography.problems("x.py", text, KNOWN))
    assert len(found) == 1
    assert found[0].startswith(said)


def test_what_is_read() -> None:
    text = "a [Gao X. n.d.,\n    eq. 12] b [Bouc 1967; Wen 1976] c = x[Wen] [link 2010](a.md) [One-link n.d., Table 2]"
    assert list(bibliography.cited(text)) == [(1, "GaoXnd"), (2, "Bouc1967"), (2, "Wen1976"), (2, "Onelinknd")]


def test_labels_lead_back_to_their_keys() -> None:
    for work in KNOWN.values():
        assert bibliography.key(bibliography.label(work)) == work.key
        assert bibliography.CITATION.fullmatch(f"[{bibliography.label(work)}]")


def test_the_page_lists_every_work() -> None:
    page = bibliography.page()
    assert re.findall(r"^### (.*)$", page, re.MULTILINE) == sorted(map(bibliography.label, KNOWN.values()), key=_order)
    assert "### Mohan 2010\n\nAshish Mohan, S. P. Singh and S. K. Saha, *A cohesive" in page
    assert "Multibody System Dynamics 23, 333 to 360, 2010, doi 10.1007/s11044-010-9188-9." in page


def _order(label: str) -> str:
    return bibliography.key(label).lower()


def test_citations_become_links() -> None:
    made = bibliography.linked("x \\[Mohan 2010, eq. 7c\\] and `[Wen 1976]`\n\n    [Wen 1976]\n", "../")
    assert made == (
        "x \\[[Mohan 2010](../reference/bibliography.md#mohan-2010), eq. 7c\\] and `[Wen 1976]`\n\n    [Wen 1976]\n"
    )


def test_a_broken_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bib"
    path.write_text("\n@book{A1999,\n  title = {x},\n  year = 1999,\n}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"a\.bib, A1999: 'year = 1999,' is not one field"):
        bibliography.works(path)
    path.write_text("\n@book{A1999,\n  title = {x},\n}\n\n@book{A1999,\n  title = {x},\n}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="'A1999' stands twice"):
        bibliography.works(path)
    path.write_text("\n@book{A1999,\n  title = {x}}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="does not end"):
        bibliography.works(path)
