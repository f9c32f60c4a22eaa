"""docs/dataset.md: the data set in figures, and how many rows of a map ask something that no other row of it asks."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from episode_builders import spec
from scripts import load_script

from tsbench.make.scenes.overview import TypeStats, dataset_tables
from tsbench.report.analyses.analysis import Analysis
from tsbench.scenarios.spec import ScenarioSpec

SCRIPT = load_script("dataset_page")
Asked, Tagging = SCRIPT.Asked, SCRIPT.Tagging
axes_of, axes_table, tagging_table = SCRIPT.axes_of, SCRIPT.axes_table, SCRIPT.tagging_table
STOP = TypeStats("stop", "test", 400, 200, 20, 18, {}, 0.5, 1.0, 0.9999, 1.0, 1.0, 0.0, 0.84, 0.25)


def cells(analysis: Analysis) -> dict[str, object]:
    heads = [column.head for column in analysis.table.columns]
    return dict(zip(heads, analysis.table.rows[0].cells, strict=True))


ASKED = Asked(("2.4", None), "south", (), "south_0", "north")
OTHER = (("3.24", 5.6, "east"),)


def rows(*asked: Any, map_id: str = "j") -> list[tuple[ScenarioSpec, Any]]:
    return [
        (replace(spec("yield-j-v0"), map_id=map_id, variant=k, density=float(k)), one) for k, one in enumerate(asked)
    ]


def test_the_page_counts_rows_by_split_and_shows_those_of_test() -> None:
    page = SCRIPT.dataset_page(dataset_tables([STOP, replace(STOP, split="train", rows=800)], []))
    assert "1,200 rows (test 400, train 800)" in page
    assert page.count("\n| stop | 400 | ") == 1
    assert "](tables/dataset-rows.csv)" in page
    assert "](tables/dataset-maps.csv)" in page


def test_in_what_rows_differ() -> None:
    found = axes_of(rows(ASKED, replace(ASKED, distractors=OTHER), replace(ASKED, plate=("2.5", None))))
    row = cells(axes_table({("stop", "test"): found}))
    assert (row["plates and values"], row["densities"], row["destinations"]) == (2, 3, 1.0)
    assert (row["apart"], row["apart without distractors"]) == ("100", "33.3")


def test_generalised_maps_and_the_goal_for_routing_types() -> None:
    within = Tagging("no_entry", "test", True, 20, 6, 30)
    over = Tagging("direction_left", "test", True, 20, 7, 13)
    table = tagging_table([within, over, Tagging("stop", "test", False, 20, 20, 0)])
    assert cells(table)["generalised"] == "30.0"
    (note,) = table.notes
    assert "test: 32.5 % generalised, 1 of 2 types above the goal" in note


@pytest.mark.parametrize(
    ("asked", "figures"),
    [
        pytest.param(rows(ASKED, ASKED, ASKED), {"apart": 0.0}, id="who asks the same is not apart"),
        *(
            pytest.param(rows(ASKED, ASKED, other), {"apart": pytest.approx(1 / 3), "apart_bare": pytest.approx(1 / 3)})
            for other in (
                replace(ASKED, plate=("2.5", None)),
                replace(ASKED, approach="west"),
                replace(ASKED, lane="south_1"),
                replace(ASKED, destination="east"),
            )
        ),
        (rows(ASKED, replace(ASKED, distractors=OTHER)), {"apart": 1.0, "apart_bare": 0.0, "distractors": 2.0}),
        # Rows of other maps do not count.
        (rows(ASKED) + rows(ASKED, map_id="k"), {"apart": 1.0, "lanes": 1.0, "plates": 1}),
        (rows(ASKED, replace(ASKED, plate=("2.4", 5.0)), ASKED), {"plates": 2, "speeds": 1, "densities": 3}),
    ],
)
def test_what_sets_rows_apart(asked: list[tuple[ScenarioSpec, Any]], figures: dict[str, float]) -> None:
    found = axes_of(asked)
    assert {name: found[name] for name in figures} == figures


def test_the_target_and_what_binds_nobody_are_read_from_the_scene() -> None:
    def plate(number: str, code: str, role: str) -> Any:
        return SimpleNamespace(id=number, code=code, value=None, edge="south", role=role)

    layout = SimpleNamespace(
        signs=(plate("a", "1.1", "context"), plate("b", "2.4", "target"), plate("c", "3.24", "distractor")),
        targets=("b",),
        start=SimpleNamespace(lane="south_0"),
        destination=SimpleNamespace(edge="north"),
    )
    asked = SCRIPT.asked_of(layout)
    assert asked == replace(ASKED, distractors=(("3.24", None, "south"),))
