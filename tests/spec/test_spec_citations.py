"""Nothing cites a page, or a section of one, that does not exist."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from spec_tables import ROOT, headings

TEXTS = {".py", ".yaml", ".md", ".toml", ".js", ".css", ".html", ".netccfg", ".xml"}
FOLDERS = ("tsbench", "tests", "sign_catalog", "scenarios/recipes", "sumo_nets/netconvert", "examples", "docs")
# docs/rules.md, "Give way": a page, and the section where one is named.
CITATION = re.compile(r"(?<![\w/.])(docs/(?:[\w-]+/)*[\w-]+\.md)(?:,\s+\"([^\"]+)\")?")
LINK = re.compile(r"\]\(([^)\s]+)\)")


def texts() -> Iterator[Path]:
    """Every file that may cite, but for this one, which holds wrong citations on purpose."""
    yield from (path for path in ROOT.iterdir() if path.is_file() and path.suffix in TEXTS)
    yield ROOT / "Makefile"
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in TEXTS and path.is_file() and path != Path(__file__):
                yield path


def dangling(text: str) -> list[str]:
    """Citations in a text that lead nowhere; links, which start from their page, are no citations."""
    text = LINK.sub("]", text)
    wrong = []
    # A citation may go over the end of a line, in a comment too.
    for page, section in CITATION.findall(re.sub(r"\n[ \t]*(?:# )?", " ", text)):
        path = ROOT / page
        if not path.is_file():
            wrong.append(f"{page}: no such page")
        elif section and section not in headings(path.read_text(encoding="utf-8")):
            wrong.append(f"{page}: no section {section!r}")
    return wrong


def anchor(title: str) -> str:
    """The name that a title gets as the end of a link."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def broken_links(path: Path, text: str) -> list[str]:
    """Links of a page, inside the repository, that lead nowhere."""
    wrong = []
    for target in LINK.findall(re.sub(r"^```.*?^```|`[^`\n]*`(?!\])", "", text, flags=re.M | re.S)):
        name, _, part = target.partition("#")
        there = (path.parent / name).resolve() if name else path
        if re.match(r"\w+:", target):
            continue
        if not there.exists():
            wrong.append(f"{target}: no such file")
        elif part and there.suffix == ".md":
            titles = headings(there.read_text(encoding="utf-8"))
            if part not in map(anchor, titles):
                wrong.append(f"{target}: no such section")
    return wrong


def test_every_citation_leads_somewhere() -> None:
    read = [(path, path.read_text(encoding="utf-8")) for path in texts()]
    wrong = {str(path.relative_to(ROOT)): found for path, text in read if (found := dangling(text))}
    assert not wrong
    # The code does cite the pages: without that nothing would have been looked at.
    cited = {page for _, text in read for page, _ in CITATION.findall(text)}
    assert {f"docs/{name}.md" for name in ("metrics", "rules", "scenes", "simulation")} <= cited


def test_every_link_of_the_pages_leads_somewhere() -> None:
    beside = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    pages = [*beside, *sorted((ROOT / "docs").rglob("*.md"))]
    found = {str(p.relative_to(ROOT)): broken_links(p, p.read_text(encoding="utf-8")) for p in pages}
    assert {name: wrong for name, wrong in found.items() if wrong} == {}
