"""What a selection selects, and what is said of one that cannot be."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import one_line
from data_folder import in_force
from run_helpers import specs

from tsbench.core.errors import InputError
from tsbench.run.execution.messages import Task, TaskQueue
from tsbench.run.options import RunOptions
from tsbench.run.plan import RunPlan, choose_variants, make_plan
from tsbench.scenarios.data_set import DataSet, write_table
from tsbench.signs.catalog import load_catalog


@pytest.fixture
def plan_of(data: Path):
    with in_force(data):
        yield lambda **options: make_plan(RunOptions(("idm",), "test", **options), DataSet())


def ids(plan: RunPlan) -> list[str]:
    return [row.scenario_id for row in plan.scenarios]


def test_everything_in_order_of_ids(plan_of) -> None:
    plan = plan_of()
    assert len(plan.scenarios) == len(plan.table) == 40
    assert ids(plan) == sorted(ids(plan))
    assert plan.types == ("yield", "speed_limit")


@pytest.mark.parametrize("word", ["speed_limit", "speed"])
def test_types_and_groups(plan_of, word: str) -> None:
    assert {row.scenario_type for row in plan_of(types=(word,)).scenarios} == {"speed_limit"}


def test_limit_touches_types_and_maps(plan_of) -> None:
    assert ids(plan_of(limit=3)) == ["speed_limit-000-0", "yield-000-0", "yield-001-0"]


def test_limit_keeps_to_the_lot_of_one_per_map(plan_of) -> None:
    drawn = {row.scenario_type: row for row in plan_of(variants="one-per-map", limit=2).scenarios}
    whole = plan_of(variants="one-per-map").scenarios
    assert {row.variant for row in drawn.values()} != {0}
    for kind, row in drawn.items():
        lots = {hashlib.sha256(r.scenario_id.encode()).hexdigest(): r for r in whole if r.scenario_type == kind}
        assert row == lots[min(lots)]


def test_variants(plan_of) -> None:
    assert {row.variant for row in plan_of(variants="0").scenarios} == {0}
    drawn = plan_of(variants="one-per-map").scenarios
    assert len({(row.scenario_type, row.map_id) for row in drawn}) == len(drawn) == 4
    assert len({row.variant for row in drawn}) > 1


@pytest.mark.parametrize("variants", ["one-per-map", "one-per-type"])
def test_the_lot_does_not_depend_on_order(variants: str) -> None:
    rows = specs()
    assert choose_variants(rows, variants) == choose_variants(rows[::-1], variants)


def test_one_of_each_type_is_one_of_those_of_its_maps(plan_of) -> None:
    drawn = plan_of(variants="one-per-type")
    assert [row.scenario_type for row in drawn.scenarios] == ["speed_limit", "yield"]
    assert set(ids(drawn)) == set(ids(plan_of(variants="one-per-map", limit=2)))


def test_a_quick_look_at_dev_has_both_halves_of_a_pair_of_each_type() -> None:
    rows = make_plan(RunOptions(("idm",), "dev", variants="one-per-type"), DataSet()).scenarios
    pairs = {row.pair_type: row.pair_name for row in rows}
    assert len(pairs) == len({row.pair_name for row in rows}) == len(load_catalog().types)
    dev = [row for row in DataSet().table("dev") if row.pair_name in pairs.values()]
    assert sorted(row.scenario_id for row in dev) == [row.scenario_id for row in rows]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"types": ("speling",)}, "--types speling: no such type or group: groups"),
        ({"types": ("yeild",)}, r"--types yeild: no such type or group \(did you mean yield\?\): groups"),
        ({"types": ("sped",)}, r"\(did you mean speed\?\)"),
        ({"types": ("detour_right",)}, "has no scenario of detour_right"),
        ({"types": ("routing",)}, "has no scenario of routing"),
    ],
)
def test_asked_for_what_is_not_there(plan_of, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan_of(**options)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scenario_type": "speling"}, "unknown type 'speling'"),
        ({"sign_code": "9.99"}, "unknown sign '9.99'"),
        ({"map_id": "nowhere"}, "unknown map 'nowhere'"),
        ({"group": "routing"}, "group 'routing' is not that of yield"),
        ({"net": "nets/gone.net.xml"}, r"\(map map-0-0\): .*gone.net.xml: no such scene file"),
    ],
)
def test_rows_that_name_what_is_not_there(plan_of, data: Path, change: dict, words: str) -> None:
    first, *rest = specs()
    write_table([replace(first, **change), *rest], data / "scenarios" / "test.parquet")
    with one_line(first.scenario_id, match=words):
        plan_of()


def test_hand_out_keeps_a_network_with_its_worker() -> None:
    tasks = [Task(n, 0, row) for n, row in enumerate(specs(), start=1)]
    hand_out = TaskQueue(tasks)
    first = [hand_out.next(worker) for _ in range(10) for worker in (0, 1)]
    nets = [{task.spec.net for task in first[worker::2]} for worker in (0, 1)]
    assert [len(found) for found in nets] == [1, 1]
    assert nets[0] != nets[1]
    rest = [hand_out.next(0) for _ in range(20)]
    assert hand_out.left == 0
    assert hand_out.next(1) is None
    assert sorted(task.number for task in [*first, *rest]) == list(range(1, 41))


def test_what_came_before_tells_nothing_of_the_half() -> None:
    """Neither half of a pair is always first, and the order of a run is not that of another one."""
    rows = [replace(specs(maps=1)[0], scenario_id=f"{pair}{half}") for pair in range(40) for half in ("", "-c")]
    tasks = [Task(n, 0, row) for n, row in enumerate(rows, start=1)]
    orders = []
    for hand_out in (TaskQueue(tasks), TaskQueue(tasks)):
        order = [hand_out.next(0).spec.scenario_id for _ in rows]
        signed_first = sum(order.index(f"{pair}") < order.index(f"{pair}-c") for pair in range(40))
        # Outside of this in one of 20,000 draws.
        assert 8 <= signed_first <= 32
        orders.append(order)
    assert sum(one == other for one, other in zip(*orders, strict=True)) < 20


def test_hand_out_of_one_network_still_keeps_all_busy() -> None:
    hand_out = TaskQueue([Task(n, 0, row) for n, row in enumerate(specs(maps=1)[:10], start=1)])
    taken = [hand_out.next(worker) for _ in range(5) for worker in (0, 1)]
    assert sorted(task.number for task in taken) == list(range(1, 11))


def test_hand_out_of_one_planner_only() -> None:
    rows = specs()
    hand_out = TaskQueue([Task(n, n % 2, row) for n, row in enumerate(rows, start=1)])
    assert hand_out.planner == 0
    taken = [hand_out.next(k % 2, 1) for k in range(20)]
    assert {task.planner for task in taken} == {1}
    assert hand_out.next(0, 1) is None
    assert hand_out.left == 20
    assert hand_out.next(0).planner == 0
    hand_out.requeue(taken[0])
    assert hand_out.next(0, 0).planner == 0
    assert hand_out.next(1, 1) is taken[0]


def test_what_is_given_back_is_handed_out_again() -> None:
    hand_out = TaskQueue([Task(1, 0, specs()[0])])
    task = hand_out.next(0)
    assert hand_out.next(1) is None
    hand_out.requeue(task)
    assert hand_out.next(1) is task


def test_a_type_selects_both_halves_and_a_limit_keeps_pairs(
    plan_of, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = [replace(r, pair_id=r.scenario_id) for r in specs() if r.scenario_type == "yield"]
    other = {"half": "contrast", "scenario_type": "speed_limit", "group": "speed", "sign_code": "3.24"}
    table += [replace(r, scenario_id=f"{r.scenario_id}-c", **other) for r in table]
    write_table(table, data / "scenarios" / "test.parquet")
    monkeypatch.setattr("tsbench.run.plan.check_files", lambda *_: None)
    plan = plan_of(types=("yield",))
    assert len(plan.scenarios) == 40
    assert plan.types == ("yield",)
    assert ids(plan_of(limit=4)) == ["yield-000-0", "yield-000-0-c", "yield-001-0", "yield-001-0-c"]
    drawn = plan_of(variants="one-per-map").scenarios
    assert len(drawn) == 4
    assert len({row.pair_id for row in drawn}) == 2
    signed = plan_of(types=("yield",), half="signed", limit=3)
    assert ids(signed) == ["yield-000-0", "yield-000-1", "yield-001-0"]
    assert {row.scenario_type for row in plan_of(half="contrast").scenarios} == {"speed_limit"}
    # Half a pair proves nothing: three rows are one pair, and so is one row.
    assert ids(plan_of(limit=3)) == ids(plan_of(limit=1)) == ["yield-000-0", "yield-000-0-c"]


def test_a_half_that_is_not_there(plan_of) -> None:
    assert len(plan_of(half="signed").scenarios) == 40
    with pytest.raises(InputError, match="--half contrast: none of the chosen scenarios is one"):
        plan_of(half="contrast")
