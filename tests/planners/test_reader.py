"""`reader` and `careful`: they obey what they were told, as what they were told it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tsbench.episode.perception_level import EXACTLY, Perception, load_level
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import resolve
from tsbench.run.log.record import make_record
from tsbench.scenarios.data_set import DataSet

READER, CAREFUL = (f"tsbench.planners.reader:{name}" for name in ("Reader", "Careful"))


def passed(planner: str, right: float | None, kind: str = "direction_right") -> list[bool]:
    """SCD of the signed and the contrast half of dev's last pair of a type. right: share read; None: exact eyes."""
    rows = [r for r in DataSet().table("dev") if r.pair_type == kind]
    halves = sorted((r for r in rows if r.pair_id == rows[-1].pair_id), key=lambda r: r.half, reverse=True)
    level = EXACTLY
    if right is not None:
        poor = load_level("poor")
        assert poor is not None
        level = Perception(level=replace(poor, right=right, misread=0.0, ceiling=1.0, false_per_km=0.0))
    runner = EpisodeRunner(resolve(planner), perception=level)
    found = [bool(make_record(runner.run(row), privileged=True).row["scd"]) for row in halves]
    runner.close()
    return found


def test_who_reads_passes_both_halves_and_who_does_not_never_both() -> None:
    for planner in (READER, CAREFUL):
        assert passed(planner, None) == [True, True]
        assert passed(planner, 1.0) == [True, True]
    assert passed(READER, 0.0) == [False, True]
    assert passed(CAREFUL, 0.0) != [True, True]


def test_the_backs_of_the_other_arms_plates_are_read() -> None:
    """At `secondary_road` the ego has no plate, and sees those of the road that it crosses from behind."""
    assert passed(READER, None, "secondary_road") == [True, True]
    assert passed(READER, 1.0, "secondary_road") == [True, True]
    assert passed(READER, 0.0, "secondary_road") == [False, True]


# The posts of stop_and_no_turn are three metres apart; in limit_in_zone one limit ends the other.
_ALONE = [("Reader", 4), ("FirstSign", 2), ("LastSign", 2)]
_SQUARES = [(*alone, kind) for kind in ("limit_and_yield", "stop_and_no_turn") for alone in _ALONE]


@pytest.mark.parametrize(("name", "rows_passed", "type_id"), [*_SQUARES, ("Reader", 4, "limit_in_zone")])
def test_one_sign_of_two_is_half_of_a_square(name: str, rows_passed: int, type_id: str) -> None:
    rows = [row for row in DataSet().table("two-signs") if row.pair_type == type_id][:4]
    assert len({row.pair_name for row in rows}) == 1
    runner = EpisodeRunner(resolve(f"tsbench.planners.reader:{name}"))
    found = [make_record(runner.run(row), privileged=True).row["scd"] for row in rows]
    runner.close()
    assert sum(found) == rows_passed
