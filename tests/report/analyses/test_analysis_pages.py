"""Tables and figures of analyses that are put into Markdown pages."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.report.analyses.pages import refresh

MAIN = """**Main table**

| planner | figure | n | SCD all | DS % |
|---|---|---:|---:|---:|
| idm | strict | 580 | 3.3 (2.9–3.4) | 70.0 (60.0–80.0) |
| a\\_b | strict | 580 | 0.0 | – |

A note.
Contract `00ff`.
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "analyses"
    made.mkdir()
    (made / "main.md").write_text(MAIN, encoding="utf-8")
    (made / "main.png").write_bytes(b"picture")
    return made


def page(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "page.md"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_stands_between_the_marks_is_written_anew_and_nothing_else(tmp_path: Path, folder: Path) -> None:
    text = (
        "# Title\n<!-- analysis main | columns planner, SCD all | contract -->\nold\n<!-- end -->\nProse.\n"
        "<!-- analysis main | bare -->\n<!-- end -->\n"
    )
    path = page(tmp_path, text)
    assert refresh(path, folder) == [path]
    assert path.read_text(encoding="utf-8") == (
        "# Title\n<!-- analysis main | columns planner, SCD all | contract -->\n"
        "| planner | SCD all |\n|---|---:|\n| idm | 3.3 (2.9–3.4) |\n| a\\_b | 0.0 |\n\nContract `00ff`.\n"
        "<!-- end -->\nProse.\n<!-- analysis main | bare -->\n"
        "| planner | SCD all | DS % |\n|---|---:|---:|\n| idm | 3.3 | 70.0 |\n| a\\_b | 0.0 | – |\n<!-- end -->\n"
    )
    before = path.read_bytes()
    refresh(path, folder)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("asked", "lines"),
    [
        ("where planner = idm | columns n, SCD all", ["| n | SCD all |", "|---:|---:|", "| 580 | 3.3 (2.9–3.4) |"]),
        ("planners a\\_b | columns planner, DS %", ["| planner | DS % |", "|---|---:|", "| a\\_b | – |"]),
        # A group that was not driven has no column.
        ("bare | columns planner, paired SCD obstacles, SCD all", ["| planner | SCD all |"]),
    ],
)
def test_some_rows_and_columns_of_a_table(tmp_path: Path, folder: Path, asked: str, lines: list[str]) -> None:
    path = page(tmp_path, f"<!-- analysis main | {asked} -->\n<!-- end -->")
    refresh(path, folder)
    assert path.read_text(encoding="utf-8").splitlines()[1:-1][: len(lines)] == lines


def test_a_long_table_is_a_file_beside_the_page(tmp_path: Path, folder: Path) -> None:
    path = page(tmp_path, "<!-- analysis main | columns planner, SCD all, DS % | csv long -->\n<!-- end -->")
    table = tmp_path / "tables" / "long.csv"
    assert refresh(path, folder) == [path, table]
    assert path.read_text(encoding="utf-8").splitlines()[1:-1] == ["[`tables/long.csv`](tables/long.csv)"]
    assert table.read_text(encoding="utf-8").splitlines() == [
        "planner,SCD all,SCD all_low,SCD all_high,DS %,DS %_low,DS %_high",
        "idm,3.3,2.9,3.4,70.0,60.0,80.0",
        "a_b,0.0,,,–,,",
    ]


def test_an_interval_with_a_negative_end_has_columns_for_its_ends(tmp_path: Path, folder: Path) -> None:
    (folder / "main.md").write_text(MAIN.replace("3.3 (2.9–3.4)", "-0.6 (-0.8 to -0.4)"), encoding="utf-8")
    path = page(tmp_path, "<!-- analysis main | columns planner, SCD all | csv long -->\n<!-- end -->")
    refresh(path, folder)
    assert (tmp_path / "tables" / "long.csv").read_text(encoding="utf-8").splitlines()[1] == "idm,-0.6,-0.8,-0.4"


def test_a_figure_is_copied_to_where_the_page_shows_it(tmp_path: Path, folder: Path) -> None:
    path = page(tmp_path, "<!-- figure main -->\n![All](images/all.png)\n")
    assert refresh(path, folder) == [path, tmp_path / "images" / "all.png"]
    assert (tmp_path / "images" / "all.png").read_bytes() == b"picture"
    assert path.read_text(encoding="utf-8") == "<!-- figure main -->\n![All](images/all.png)\n"


def test_a_contract_that_is_not_named_is_refused(tmp_path: Path, folder: Path) -> None:
    told = (folder / "main.md").read_text(encoding="utf-8")
    (folder / "main.md").write_text(told[: told.index("Contract")], encoding="utf-8")
    with pytest.raises(InputError, match="names no contract"):
        refresh(page(tmp_path, "<!-- analysis main | contract -->\n<!-- end -->"), folder)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("no marks", "page.md"),
        ("<!-- analysis main -->\n", "<!-- end -->"),
        ("<!-- analysis types -->\n<!-- end -->", "types.md"),
        ("<!-- analysis main | columns speed -->\n<!-- end -->", "'speed'"),
        ("<!-- analysis main | where speed = 1 -->\n<!-- end -->", "'speed'"),
        ("<!-- analysis main | planners idm, ghost -->\n<!-- end -->", "no row of planner ghost"),
        ("<!-- analysis main | short -->\n<!-- end -->", "'short'"),
        ("<!-- figure types -->\n![x](x.png)", "types.png"),
    ],
)
def test_what_is_not_there_is_refused_and_the_page_left_alone(
    text: str, names: str, tmp_path: Path, folder: Path
) -> None:
    path = page(tmp_path, text)
    with pytest.raises(InputError, match=names):
        refresh(path, folder)
    assert path.read_text(encoding="utf-8") == text


def test_the_table_of_metrics_is_what_the_code_declares(tmp_path: Path, folder: Path) -> None:
    written = Path(__file__).parents[3] / "docs" / "metrics.md"
    copy = page(tmp_path, written.read_text(encoding="utf-8"))
    refresh(copy, folder)
    assert copy.read_text(encoding="utf-8") == written.read_text(encoding="utf-8"), (
        "tsbench analyse pages docs/metrics.md writes it anew"
    )
