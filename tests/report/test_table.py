"""The tables: right figures, readable at 100 columns, hostile names are only text."""

from __future__ import annotations

import io
from itertools import pairwise

import pytest
from rich.console import Console
from table_builders import random_rows, records, row

from tsbench.metrics.aggregate import Summary, summarise
from tsbench.report.analyses import analysis as markdown
from tsbench.report.analyses.analysis import Analysis, Column, Kind, Row, Table, Value, print_analysis
from tsbench.report.analyses.run_analyses import main_table, run_tables
from tsbench.run.edition import in_force, standing_contract
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog

HOSTILE = "[red]<b>my.py:Planner|x[/red]"


def made(planners: tuple[str, ...] = ("idm",), errors: float = 0.0, extra: int = 0) -> Summary:
    rows = random_rows(planners, errors=errors)
    asked = dict.fromkeys(planners, 144 + extra)
    return summarise(records(rows), contract_hash="4f" * 32, asked=asked, allow_partial=bool(extra))


def printed(summary: Summary, width: int = 100) -> str:
    file = io.StringIO()
    for table in run_tables(summary):
        print_analysis(table, Console(file=file, width=width, color_system=None))
    return file.getvalue()


def to_markdown(summary: Summary) -> str:
    return "\n".join(markdown.to_markdown(table) for table in run_tables(summary))


def test_it_fits_and_says_what_it_rests_on() -> None:
    text = printed(made(("idm", "idm-e", "plant2-ft")))
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
    assert "6 of 29 types" in text
    assert "contract " + "4f" * 32 in text
    assert " 144 " in text
    assert "type05" in text
    assert "PARTIAL" not in text


def test_figures_are_those_of_the_summary() -> None:
    summary = made()
    overall = summary.planners[0].primary.overall.strict
    assert overall is not None
    text = printed(summary)
    assert f"{overall.value:.1f}" in text
    assert f"{overall.low:.1f}–{overall.high:.1f}" in text
    kind = summary.planners[0].primary.types["type03"].strict
    assert f"| {kind.value:.1f} ({kind.low:.1f}–{kind.high:.1f}) | {kind.n} | 8 |" in to_markdown(summary)


def test_errors_add_the_completed_figure() -> None:
    assert "  completed " not in printed(made())
    text = printed(made(errors=0.1))
    assert "  completed " in text
    assert "sim_error" in text
    assert "errors/" in text


def test_no_figure_stands_without_what_it_rests_on() -> None:
    summary = made(errors=0.1)
    p = summary.planners[0]
    lines = to_markdown(summary).splitlines()
    completed = p.primary.overall.completed
    row = f"| idm | completed | {completed.n} | {completed.value:.1f} ({completed.low:.1f}–{completed.high:.1f}) |"
    assert any(line.startswith(row) for line in lines)
    fewer = {kind: figure.completed for kind, figure in p.primary.types.items() if figure.completed.n < 24}
    assert fewer
    for kind, completed in fewer.items():
        strict, below = (line for line in lines if f"| {kind} |" in line)
        assert strict.endswith("| 24 | 8 |")
        assert f"| completed | {completed.value:.1f} " in below
        assert below.endswith(f"| {completed.n} | {completed.clusters} |")
    assert "| completed |" not in to_markdown(made())


def test_planners_of_a_partial_run_that_rest_on_different_numbers() -> None:
    rows = [row(map_id=f"m{k}") for k in range(8)] + [row("idm-e", map_id=f"m{k}") for k in range(6)]
    summary = summarise(records(rows), contract_hash="c", asked={"idm": 8, "idm-e": 8}, allow_partial=True)
    (line,) = (line for line in to_markdown(summary).splitlines() if "| yield |" in line)
    cells = [cell.strip() for cell in line.split("|")]
    assert (cells[6], cells[8], cells[9]) == ("8", "6", "6–8")


def test_metrics_that_apply_to_fewer_episodes_say_so() -> None:
    rows = [row(map_id=f"m{k}", efficiency=90.0 if k < 6 else None) for k in range(8)]
    summary = summarise(records(rows), contract_hash="c", asked={"idm": 8})
    assert "idm: efficiency could be computed for 6 of 8 completed episodes" in printed(summary)


def test_partial_figures_say_so_first() -> None:
    summary = made(extra=5)
    assert printed(summary).lstrip().startswith("PARTIAL, 5 episodes missing")
    assert "PARTIAL" in to_markdown(summary)


def test_few_maps_say_why_there_is_no_interval() -> None:
    rows = [row(map_id=f"m{k}", scd=k == 0) for k in range(3)]
    summary = summarise(records(rows), contract_hash="c", asked={"idm": 3})
    assert "no interval for the overall signed SCD: only 3 places, fewer than 5" in printed(summary)


def test_many_planners_still_fit() -> None:
    text = printed(made(tuple(f"planner-{k:02d}" for k in range(16))))
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
    assert text.count("planner-15") == 3  # in both parts of the main table, and over its column by type


def in_columns(summary: Summary, width: int) -> list[str]:
    """The lines of the printed tables, without the one that holds a hash and stays whole."""
    return [line.rstrip() for line in printed(summary, width).splitlines() if "contract " not in line]


@pytest.mark.parametrize("planners", [("idm",), ("idm", "idm-e", "plant2-ft"), (HOSTILE, "idm")])
def test_tables_fit_eighty_columns_with_every_head(planners: tuple[str, ...]) -> None:
    summary = made(planners)
    lines = in_columns(summary, 80)
    assert max(map(len, lines)) <= 80
    heads = [line.split() for line, below in pairwise(lines) if below.startswith("───")]
    wide = [line.split() for line, below in pairwise(in_columns(summary, 1000)) if below.startswith("───")]
    # Every head of the wide table stands in some part of the narrow one.
    assert {word for head in wide for word in head} == {word for head in heads for word in head}


def test_a_long_text_is_folded() -> None:
    reason = "none (only 3 places, fewer than 5 of them, and they are all of one and the same road)"
    columns = (Column("planner", "planner", Kind.TEXT), Column("scd", "SCD"), Column("why", "interval", Kind.TEXT))
    table = Table(columns, (Row(("a" * 40, Value(12.5, n=3), reason)),), 1)
    file = io.StringIO()
    print_analysis(Analysis("x", "title", "", table, ()), Console(file=file, width=60, color_system=None))
    text = file.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 60
    assert "interval" in text
    assert set(reason.replace("(", "").split()) <= set(text.replace("(", "").split())


def beside(kinds: list[tuple[str, str]], contract: str) -> str:
    """The main table over five places of each type, under a contract."""
    rows = [row(kind=kind, group=group, map_id=f"{kind}-{k}") for kind, group in kinds for k in range(5)]
    planners = summarise(records(rows), contract_hash=contract, asked={"idm": len(rows)}).planners
    return markdown.to_markdown(main_table(planners, "", contract, contract))


def test_published_figures_stand_beside_all_types_of_the_test_split_alone() -> None:
    kinds = [(kind.id, kind.group) for kind in load_catalog().types]
    contract, published = standing_contract(in_force(DataSet()).now()["test"]), "idm | published"
    assert published in beside(kinds, contract)
    # A selection of the types has another mean, other scenes have other figures.
    few = [(kind, group) for kind, group in kinds if kind != "yield" and group != "speed"][:9]
    assert published not in beside(few, contract)
    assert published not in beside(kinds, "c")
    # Of a group that is there wholly the published figure is comparable.
    speed = beside([k for k in kinds if k[1] == "speed"], contract)
    (line,) = [x for x in speed.splitlines() if published in x]
    assert line.split(" | ")[3:5] == ["–", "26.6"]


def test_hostile_names_are_text() -> None:
    summary = made((HOSTILE,))
    text = printed(summary)
    assert "[red]<b>" in text
    line = next(line for line in to_markdown(summary).splitlines() if "my.py" in line)
    assert "&#124;x" in line


def test_markdown_is_a_table() -> None:
    lines = to_markdown(made(("idm", "idm-e"))).splitlines()
    table = [line for line in lines if line.startswith("|")]
    heads = [k for k, line in enumerate(table) if line.startswith("|---")]
    assert (heads[0], len(heads)) == (1, 2)  # the main table, and the one by type
    for part in (table[: heads[1] - 1], table[heads[1] - 1 :]):
        assert len({line.count("|") for line in part}) == 1
    assert len(table[: heads[1] - 1]) == 4  # head, rule, and each planner's own figures
    assert any(line.startswith("Contract `") for line in lines)
