"""Who stands and watches, or leaves its lane to be let through, is told nothing before its line."""

from __future__ import annotations

from functools import cache
from itertools import cycle
from pathlib import Path

import pytest
from simworld import simulation

import tsbench
from tsbench.make.certify import certifier
from tsbench.make.certify.certifier import Certifier
from tsbench.make.certify.evidence import HABITS, Habit, alike_to_others, drawn_habits
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.sim import junction_traffic

ROOT = Path(tsbench.__file__).parent.parent
Pair = tuple[ScenarioSpec, ScenarioSpec]
# Where plates decide what others do: each habit on a pair of two of them.
PRIORITY = ("yield", "stop", "secondary_road", "main_road", "crosswalk")


@cache
def pairs() -> list[Pair]:
    """The pairs of the dev split, in the order of their names."""
    halves: dict[str, dict[str, ScenarioSpec]] = {}
    for row in DataSet().table("dev"):
        if row.pair_id:
            halves.setdefault(row.pair_id, {})[row.half] = row
    return [(pair[SIGNED], pair[CONTRAST]) for _, pair in sorted(halves.items()) if len(pair) == 2]


def of_type(name: str) -> list[Pair]:
    return [pair for pair in pairs() if pair[0].pair_type == name]


def told_too_soon(pair: Pair, habit: Habit) -> bool:
    """Could the watcher still stop at its line, with what a certificate allows, when others first differ?"""
    return Certifier(simulation(), SceneLoader(DataSet())).shown_to(habit, *pair) is not None


@pytest.mark.parametrize("habit", HABITS, ids=lambda habit: habit.name)
def test_others_tell_nothing_at_junctions_and_crossings(habit: Habit) -> None:
    number = HABITS.index(habit)
    for kind in (PRIORITY[number % 5], PRIORITY[(number + 2) % 5]):
        there = of_type(kind)
        assert not told_too_soon(there[number % len(there)], habit), kind


def test_others_tell_nothing_in_any_pair() -> None:
    """One of each other type."""
    some = [of_type(kind)[0] for kind in sorted({p[0].pair_type for p in pairs()}.difference(PRIORITY))]
    wrong = [
        (pair[0].pair_id, habit.name)
        for pair, habit in zip(some, cycle(HABITS), strict=False)
        if told_too_soon(pair, habit)
    ]
    assert len(some) == 20
    assert wrong == []


def test_others_tell_nothing_to_a_driver_that_rushes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The convoy hurries for it, in both halves alike."""
    rushes = resolve(f"{ROOT}/examples/attacks.py:Rushes")
    monkeypatch.setattr(certifier, "Watcher", lambda habit, approach: rushes.factory())
    wrong = [p[0].pair_id for kind in PRIORITY for p in of_type(kind)[:1] if told_too_soon(p, HABITS[0])]
    assert wrong == []


def test_a_junction_without_its_keeper_tells_who_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check finds what it looks for."""
    monkeypatch.setattr(junction_traffic, "exchangeable", lambda scene: False)
    habit = next(habit for habit in HABITS if habit.name == "stands at 20 m")
    assert all(any(told_too_soon(pair, habit) for pair in of_type(kind)) for kind in PRIORITY[:4])


def test_a_certificate_tries_some_habits_of_all_by_the_name_of_the_pair() -> None:
    drawn = [drawn_habits(f"pair-{k}") for k in range(60)]
    assert drawn == [drawn_habits(f"pair-{k}") for k in range(60)]
    assert {len(habits) for habits in drawn} == {2}
    assert {habit.name for habits in drawn for habit in habits} == {habit.name for habit in HABITS}


def alike(pair: Pair) -> bool:
    loader = SceneLoader(DataSet())
    one, other = (loader.load(half)[0] for half in pair)
    return alike_to_others(one, other)


def test_only_where_plates_are_about_others_are_the_halves_not_alike_to_them() -> None:
    """In these types a certificate tries watching drivers; in the rest there is nothing that they could be shown."""
    kinds = sorted({pair[0].pair_type for pair in pairs()})
    assert [kind for kind in kinds if not alike(of_type(kind)[-1])] == sorted(PRIORITY)
