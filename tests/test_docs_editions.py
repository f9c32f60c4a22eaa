"""Which edition the figures of a page are of: a page with a contract names it, and older ones lie in the archive."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tsbench.run.edition import editions

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
ARCHIVE = DOCS / "archive"
PAGES = [ROOT / "README.md", *sorted(page for page in DOCS.rglob("*.md") if ARCHIVE not in page.parents)]
ARCHIVED = sorted(ARCHIVE.rglob("*.md"))
_CONTRACT = re.compile(r"[Cc]ontract `([0-9a-f]{64})`")
_FIRST_LINES = 6

*OLDER, IN_FORCE = editions()


def hashes(name: str) -> set[str]:
    """All contracts of an edition."""
    (edition,) = [one for one in editions() if one.name == name]
    return edition.contracts()


def wrong(text: str) -> str | None:
    """What is wrong with a page that lies outside of the archive; None where nothing is."""
    found = set(_CONTRACT.findall(text))
    # Contracts of cities stand in no list of editions: one of the edition in force stands beside them.
    if not found or found & hashes(IN_FORCE.name):
        old = {one.name for one in OLDER if found & hashes(one.name)}
        if old:
            return f"shows figures of edition {', '.join(sorted(old))} too: move them to docs/archive"
        named = not found or f"dition {IN_FORCE.name}" in text
        return None if named else f"does not name its edition, {IN_FORCE.name}"
    told = any("of an older edition" in line for line in text.splitlines()[:_FIRST_LINES])
    return (
        None if told else f"shows no contract of the edition in force, {IN_FORCE.name}: archive it, or say so"
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_with_figures_is_of_the_edition_in_force_and_names_it(page: Path) -> None:
    assert wrong(page.read_text(encoding="utf-8")) is None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_only_the_page_on_editions_leads_to_the_archive(page: Path) -> None:
    links = re.findall(r"\]\(([^)]*archive/[^)]*)\)", page.read_text(encoding="utf-8"))
    assert page == DOCS / "editions.md" or links == []


@pytest.mark.parametrize("page", ARCHIVED, ids=lambda page: str(page.relative_to(ROOT)))
def test_an_archived_page_says_so_in_its_first_line(page: Path) -> None:
    edition = page.relative_to(ARCHIVE).parts[0]
    assert edition in {one.name for one in OLDER}
    assert page.read_text(encoding="utf-8").startswith(f"> **Archive of edition {edition}.**")


def test_the_check_finds_figures_of_another_edition() -> None:
    ours, theirs = (sorted(hashes(one.name))[0] for one in (IN_FORCE, OLDER[-1]))
    assert wrong(f"# Edition {IN_FORCE.name}\nContract `{ours}`.") is None
    assert "does not name" in (wrong(f"# Results\nContract `{ours}`.") or "")
    assert "docs/archive" in (
        wrong(f"# Edition {IN_FORCE.name}\nContract `{ours}`, contract `{theirs}`.") or ""
    )
    assert "no contract" in (wrong(f"# Edition {IN_FORCE.name}\nContract `{'0' * 64}`.") or "")
    assert wrong(f"# Figures of an older edition\nContract `{theirs}`.") is None
    assert wrong("# A page without figures") is None
