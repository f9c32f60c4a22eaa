"""The documentation as a site: it builds without a warning, every page has its place, and it asks nobody."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path, PurePosixPath
from types import ModuleType
from urllib.parse import unquote

import pytest
import yaml

import tsbench

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as `make docs` does. `strict`: a broken link, or a page that the menu has not, fails."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(folder)],
        cwd=ROOT, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, timeout=200,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_every_page_is_there_with_its_pictures(site: Path) -> None:
    pages = {p.relative_to(ROOT / "docs").with_suffix("") for p in (ROOT / "docs").rglob("*.md")}
    built = {p.relative_to(site).with_suffix("") for p in site.rglob("*.html")}
    renamed = {p.with_name("index") if p.name == "README" else p for p in pages}
    assert renamed <= built
    for page in site.rglob("*.html"):
        for source in re.findall(r'<img[^>]* src="([^":]+)"', page.read_text(encoding="utf-8")):
            assert (page.parent / source).is_file(), (page, source)


def _targets(page: Path) -> list[tuple[Path, str]]:
    """Links of a page into the site: the file, and the place in it."""
    found = re.findall(r'<a[^>]* href="(?![a-z]+:)([^"#]*)(?:#([^"]*))?"', page.read_text(encoding="utf-8"))
    return [
        ((page.parent / unquote(file)).resolve() if file else page, unquote(anchor)) for file, anchor in found
    ]


def test_every_link_leads_to_a_file_and_a_place_in_it(site: Path) -> None:
    ids = {p: set(re.findall(r' id="([^"]+)"', p.read_text(encoding="utf-8"))) for p in site.rglob("*.html")}
    for page in (p for p in ids if p.name != "404.html"):
        for file, anchor in _targets(page):
            there = file / "index.html" if file.is_dir() else file
            assert there.is_file(), (page, file)
            assert not anchor or there not in ids or anchor in ids[there], (page, file, anchor)


def test_every_command_has_its_section(site: Path) -> None:
    text = (site / "reference/commands.html").read_text(encoding="utf-8")
    for name in ("tsbench run", "tsbench scenarios certify", "tsbench train plant2-ft", "tsbench city build"):
        assert f'id="{name.replace(" ", "-")}"' in text
    assert "--memory-limit" in text


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == tsbench.__version__
    assert {"cff-version", "message", "title", "authors"} <= set(citation)


def test_it_asks_no_other_server(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'<(?:script|img|link rel="stylesheet")[^>]* (?:src|href)="https?:', text), page


def test_names_of_the_package_are_explained(site: Path) -> None:
    text = (site / "api.html").read_text(encoding="utf-8")
    for name in ("Observation", "PlannerContext", "Control", "RoadAhead", "pursue_route", "RoadMap"):
        assert f'.{name}"' in text


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / "packaging/site_hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("page", "text", "shown"),
    [
        ("a.md", "[x](b.md#c)", "[x](b.md#c)"),
        ("signs/a.md", "[x](../b.md)", "[x](../b.md)"),
        ("a.md", "[the seed](../tsbench/core/seeds.py)", "the seed (`tsbench/core/seeds.py`)"),
        ("signs/a.md", "[`Makefile`](../../Makefile)", "`Makefile`"),
        ("a.md", "![x](../README.md) [y](https://a.b/../c)", "![x](../README.md) [y](https://a.b/../c)"),
    ],
)
def test_links_that_leave_the_pages_are_words(hooks: ModuleType, page: str, text: str, shown: str) -> None:
    assert hooks.without_links_out(text, PurePosixPath(page)) == shown
