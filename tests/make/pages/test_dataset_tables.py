"""The data set in tables, and how many rows of a map ask something that no other row of it asks."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tsbench.make.dataset_tables import (
    Asked,
    Tagging,
    asked_of,
    axes_of,
    axes_table,
    dataset_page,
    dataset_tables,
    tagging_table,
)
from tsbench.make.scenes.overview import TypeStats
from tsbench.report.analyses.analysis import Analysis
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import SceneLayout

STOP = TypeStats("stop", "test", 400, 200, 20, 18, {"T": 12, "X": 8}, 0.5, 1.0, 0.9999, 1.0, 1.0, 0.0, 0.84, 0.25)
REPORT = [
    {
        "type_id": "stop",
        "split": "test",
        "missed": {"X": 2},
        "reasons": {"others | go first": 3, "plate # stands # m along": 1},
        "draws": {"no": 4},
    }
]


def cells(analysis: Analysis) -> dict[str, object]:
    heads = [column.head for column in analysis.table.columns]
    return dict(zip(heads, analysis.table.rows[0].cells, strict=True))


def test_a_share_is_whole_only_where_it_is() -> None:
    rows = cells(dataset_tables([STOP], REPORT)[0])
    assert rows["solvable"] == "100"
    assert rows["tempting"] == "99.9"
    assert rows["again"] == "0"
    assert rows["gap s"] == 0.84


def test_where_there_is_nobody_and_no_pair_there_is_no_figure() -> None:
    rows = cells(dataset_tables([STOP], REPORT)[0])
    assert (rows["pairs"], rows["seen"]) == (200, "25.0")
    rows = cells(dataset_tables([replace(STOP, gap_s=math.nan, pairs=0, seen=math.nan)], REPORT)[0])
    assert (rows["gap s"], rows["seen"]) == (None, "")


def test_quotas_and_reasons() -> None:
    maps = cells(dataset_tables([STOP], REPORT)[1])
    assert maps["maps by stratum"] == "T 12, X 8"
    assert maps["quota missed"] == "X 2"
    assert maps["maps passed over, by reason"] == "3 others | go first; 1 plate … stands … m along"
    assert maps["draws passed over"] == "4 no"


def test_the_page_counts_rows_by_split_and_shows_those_of_test() -> None:
    page = dataset_page(dataset_tables([STOP, replace(STOP, split="train", rows=800)], REPORT), "tables")
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


SPEC = ScenarioSpec(
    "yield-j-v0", "yield", "priority", "2.4", None, "j", "junction", "T", "", 0, "test", 1, 7.75, 90.0, 0.0, -1, 0,
    600, "", "", "", "",
)  # fmt: skip
ASKED = Asked(("2.4", None), "south", (), "south_0", "north")
OTHER = (("3.24", 5.6, "east"),)


def rows(*asked: Asked, map_id: str = "j") -> list[tuple[ScenarioSpec, Asked]]:
    return [(replace(SPEC, map_id=map_id, variant=k, density=float(k)), one) for k, one in enumerate(asked)]


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
def test_what_sets_rows_apart(asked: list[tuple[ScenarioSpec, Asked]], figures: dict[str, float]) -> None:
    found = axes_of(asked)
    assert {name: found[name] for name in figures} == figures


def test_the_target_and_what_binds_nobody_are_read_from_the_scene() -> None:
    def plate(number: str, code: str, role: str) -> Any:
        return SimpleNamespace(id=number, code=code, value=None, edge="south", role=role)

    layout = SimpleNamespace(
        signs=(plate("a", "1.1", "context"), plate("b", "2.4", "target"), plate("c", "3.24", "distractor")),
        target="b",
        start=SimpleNamespace(lane="south_0"),
        destination=SimpleNamespace(edge="north"),
    )
    asked = asked_of(cast(SceneLayout, layout))
    assert asked == replace(ASKED, distractors=(("3.24", None, "south"),))
