"""How many rows of a map ask something that no other row of it asks."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tsbench.make.pages.dataset_tables import Asked, asked_of, axes_of
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import SceneLayout

SPEC = ScenarioSpec(
    "yield-j-v0", "yield", "priority", "2.4", None, "j", "junction", "T", "", 0, "test", 1, 7.75, 90.0, 0.0, -1, 0,
    600, "", "", "", "",
)  # fmt: skip
ASKED = Asked(("2.4", None), "south", (), "south_0", "north")
OTHER = (("3.24", 5.6, "east"),)


def rows(*asked: Asked, map_id: str = "j") -> list[tuple[ScenarioSpec, Asked]]:
    return [(replace(SPEC, map_id=map_id, variant=k, density=float(k)), one) for k, one in enumerate(asked)]


def test_who_asks_the_same_is_not_apart() -> None:
    assert axes_of("yield", "test", rows(ASKED, ASKED, ASKED)).apart == 0.0


def test_each_part_of_what_is_asked_sets_a_row_apart() -> None:
    for other in (
        replace(ASKED, plate=("2.5", None)),
        replace(ASKED, approach="west"),
        replace(ASKED, lane="south_1"),
        replace(ASKED, destination="east"),
    ):
        found = axes_of("yield", "test", rows(ASKED, ASKED, other))
        assert found.apart == found.apart_bare == pytest.approx(1 / 3)


def test_distractors_alone_are_told_from_the_rest() -> None:
    found = axes_of("yield", "test", rows(ASKED, replace(ASKED, distractors=OTHER)))
    assert (found.apart, found.apart_bare, found.distractors) == (1.0, 0.0, 2.0)


def test_rows_of_other_maps_do_not_count() -> None:
    found = axes_of("yield", "test", rows(ASKED) + rows(ASKED, map_id="k"))
    assert (found.apart, found.lanes, found.plates) == (1.0, 1.0, 1)


def test_values_are_counted_once_a_type() -> None:
    found = axes_of("yield", "test", rows(ASKED, replace(ASKED, plate=("2.4", 5.0)), ASKED))
    assert (found.plates, found.speeds, found.densities) == (2, 1, 3)


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
