"""The documentation as a site: it builds without a warning, every page has its place, and it asks nobody."""

from __future__ import annotations

import json
import re
from pathlib import Path, PurePosixPath
from types import ModuleType
from urllib.parse import unquote

import pytest
from scripts import load_script

from tsbench.signs.catalog import load_catalog

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


def test_every_page_is_there_with_its_pictures(site: Path) -> None:
    pages = {p.relative_to(ROOT / "docs").with_suffix("") for p in (ROOT / "docs").rglob("*.md")}
    built = {p.relative_to(site).with_suffix("") for p in site.rglob("*.html")}
    renamed = {p.with_name("index") if p.name == "README" else p for p in pages}
    assert renamed <= built
    for page in site.rglob("*.html"):
        for source in re.findall(r'<img[^>]* src="([^":]+)"', page.read_text(encoding="utf-8")):
            assert (page.parent / source).is_file(), (page, source)


def test_every_scenario_type_has_a_page_with_both_films(site: Path) -> None:
    for kind in load_catalog().types:
        page = (site / "signs" / f"{kind.id}.html").read_text(encoding="utf-8")
        assert f'src="pictures/{kind.id}-violation.gif"' in page
        assert f'src="pictures/{kind.id}-pass.gif"' in page


def test_every_page_has_a_title_and_a_description_of_its_own(site: Path) -> None:
    pages = [p.read_text(encoding="utf-8") for p in site.rglob("*.html") if p.name != "404.html"]
    for what, longest in (
        (r"<title>(.+) - tsbench</title>", 75),
        (r'<meta name="description" content="([^"]+)">', 170),
    ):
        found = [re.findall(what, page) for page in pages]
        assert [len(f) for f in found] == [1] * len(pages)
        assert len({f[0] for f in found}) == len(pages)
        assert [f[0] for f in found if len(f[0]) > longest] == []


def test_every_picture_is_shown_by_a_page() -> None:
    """Pictures that no page shows are weight without use. A page names a picture by its path from its own folder."""
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")]
    named = re.compile(r'(?:\]\(|src="|href=")([^)"\s]+\.(?:png|gif|svg|jpg))')
    shown = set()
    for page in pages:
        for name in named.findall(page.read_text(encoding="utf-8")):
            shown.add((page.parent / unquote(name)).resolve())
    there = set((ROOT / "docs" / "images").iterdir())
    assert sorted(str(p.relative_to(ROOT)) for p in there - shown) == []


def _targets(page: Path) -> list[tuple[Path, str]]:
    """Links of a page into the site: the file, and the place in it."""
    found = re.findall(r'<a[^>]* href="(?![a-z]+:)([^"#]*)(?:#([^"]*))?"', page.read_text(encoding="utf-8"))
    return [((page.parent / unquote(file)).resolve() if file else page, unquote(anchor)) for file, anchor in found]


def test_every_link_leads_to_a_file_and_a_place_in_it(site: Path) -> None:
    ids = {p: set(re.findall(r' id="([^"]+)"', p.read_text(encoding="utf-8"))) for p in site.rglob("*.html")}
    for page in (p for p in ids if p.name != "404.html"):
        for file, anchor in _targets(page):
            there = file / "index.html" if file.is_dir() else file
            assert there.is_file(), (page, file)
            assert not anchor or there not in ids or anchor in ids[there], (page, file, anchor)


def test_it_asks_no_other_server(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'<(?:script|img|link rel="stylesheet")[^>]* (?:src|href)="https?:', text), page


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    return load_script("site_hooks")


@pytest.mark.parametrize(
    ("page", "text", "shown"),
    [
        ("a.md", "[x](b.md#c)", "[x](b.md#c)"),
        ("signs/a.md", "[x](../b.md)", "[x](../b.md)"),
        ("a.md", "[the seed](../tsbench/core/seeds.py)", "the seed (`tsbench/core/seeds.py`)"),
        ("signs/a.md", "[`Makefile`](../../Makefile)", "`Makefile`"),
        ("a.md", "[`seeds.py`](../tsbench/core/seeds.py)", "`tsbench/core/seeds.py`"),
        ("a.md", "![x](../README.md) [y](https://a.b/../c)", "![x](../README.md) [y](https://a.b/../c)"),
    ],
)
def test_links_that_leave_the_pages_are_words(hooks: ModuleType, page: str, text: str, shown: str) -> None:
    assert hooks.without_links_out(text, PurePosixPath(page)) == shown


def test_a_link_to_no_file_is_a_warning(hooks: ModuleType, caplog: pytest.LogCaptureFixture) -> None:
    hooks.without_links_out("[x](../tsbench/core/seeds.py) [y](../tsbench/no_such.py)", PurePosixPath("a.md"))
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    assert "'../tsbench/no_such.py'" in record.getMessage()
    assert record.name.startswith("mkdocs.")


@pytest.mark.parametrize("name", ["first_run", "learn_from_drives"])
def test_a_notebook_is_a_page(name: str, site: Path) -> None:
    page = (site / f"guides/{name}_notebook.html").read_text(encoding="utf-8")
    cells = json.loads((ROOT / f"docs/guides/{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    assert page.count('<div class="highlight">') == sum(cell["cell_type"] == "code" for cell in cells)
    assert f'href="{name}.ipynb"' in page
    assert "%%writefile" not in page
