"""The player's time to conflict, against what the monitors say of the same drives."""

from __future__ import annotations

import numpy as np
import pytest

from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, trace_of
from tsbench.planners.registry import resolve
from tsbench.report.time_to_collision import FARTHEST_S, times_to_conflict
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.sim.world import DT_S

BLOCKED = "entered_while_blocked"
GIVE_WAY = ("yield signed", "secondary_road signed")


@pytest.fixture(scope="module")
def drives() -> dict[str, Trace]:
    """`idm` in the first scene of some types and halves; it reads no sign."""
    runner = EpisodeRunner(resolve("idm"))
    wanted = {"yield signed", "yield contrast", "speed_limit signed"}
    found: dict[str, Trace] = {}
    for row in DataSet().table("dev"):
        name = f"{row.pair_type} {row.half}"
        again = name in GIVE_WAY and BLOCKED not in found
        if again or name in wanted - found.keys():
            trace = trace_of(runner.run(row))
            found.setdefault(name, trace)
            # A graver clause about the vehicle that comes first would hide its gap.
            if name in GIVE_WAY and {e.clause for e in trace.against} == {BLOCKED}:
                found[BLOCKED] = trace
    return found


def test_at_the_entry_it_is_what_the_rule_measured(drives: dict[str, Trace]) -> None:
    trace = drives[BLOCKED]
    event = next(e for e in trace.against if e.clause == BLOCKED)
    curve = times_to_conflict(trace, load_scene(DataSet(), trace.spec))
    assert curve[round(event.start_s / DT_S)] == pytest.approx(event.value, abs=1e-9)
    assert curve[0] > FARTHEST_S
    assert curve[-1] > FARTHEST_S  # the ego has left the junction


def test_both_halves_of_a_pair_have_the_same_curve(drives: dict[str, Trace]) -> None:
    """Whoever has priority: a driver who reads no sign meets the same cars."""
    curves = [
        times_to_conflict(trace, load_scene(DataSet(), trace.spec))
        for trace in (drives["yield signed"], drives["yield contrast"])
    ]
    assert curves[0] is not None
    assert curves[1] is not None
    until = round(5.0 / DT_S)
    assert np.array_equal(curves[0][:until], curves[1][:until])
    assert curves[0].min() < FARTHEST_S


def test_other_plates_have_none(drives: dict[str, Trace]) -> None:
    trace = drives["speed_limit signed"]
    assert times_to_conflict(trace, load_scene(DataSet(), trace.spec)) is None
