"""Which edition the figures of a page are of: a page with a contract names the edition in force."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tsbench.run.edition import editions, in_force
from tsbench.scenarios.data_set import DataSet

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
_CONTRACT = re.compile(r"[Cc]ontract `([0-9a-f]{64})`")
_FIRST_LINES = 6

IN_FORCE = in_force(DataSet())
OTHERS = [edition for edition in editions() if edition.name != IN_FORCE.name]


def hashes(name: str) -> set[str]:
    """All contracts of an edition."""
    (edition,) = [one for one in editions() if one.name == name]
    return edition.contracts()


def wrong(text: str) -> str | None:
    """What is wrong with the text of a page; None where nothing is."""
    found = set(_CONTRACT.findall(text))
    # Contracts of cities stand in no list of editions: one of the edition in force stands beside them.
    if not found or found & hashes(IN_FORCE.name):
        old = {one.name for one in OTHERS if found & hashes(one.name)}
        if old:
            return f"shows figures of edition {', '.join(sorted(old))} too: remove them"
        named = not found or f"dition {IN_FORCE.name}" in text
        return None if named else f"does not name its edition, {IN_FORCE.name}"
    told = any("of an older edition" in line for line in text.splitlines()[:_FIRST_LINES])
    return None if told else f"shows no contract of the edition in force, {IN_FORCE.name}: remove it, or say so"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_with_figures_is_of_the_edition_in_force_and_names_it(page: Path) -> None:
    assert wrong(page.read_text(encoding="utf-8")) is None
