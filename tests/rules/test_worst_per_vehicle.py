from __future__ import annotations

import pytest
from labelled import CASES, play

from tsbench.rules.crossing import WorstPerVehicle
from tsbench.rules.monitor import EventLog
from tsbench.signs.catalog import load_catalog

PLAYED = play(CASES / "give_way" / "two_vehicles_at_once.yaml")
TICKS = PLAYED.ticks


def test_of_each_road_user_the_gravest_clause_is_an_event_with_its_own_ticks_and_worst_value() -> None:
    log = EventLog(PLAYED.scene.target_signs[0], load_catalog().rule("give_way"))
    found = WorstPerVehicle(log, ("contact", "forced_braking", "entered_while_blocked"))
    found.note(0, "entered_while_blocked", TICKS[3], 2.0, 4.0)
    for step, value in ((5, 3.0), (6, 4.5), (8, 2.6)):
        found.note(0, "forced_braking", TICKS[step], value, 2.5)
    found.note(1, "entered_while_blocked", TICKS[4], 3.0, 4.0)
    assert log.verdict(False).violations == ()
    found.close()
    found.close()
    verdict = log.verdict(False)
    first, second = verdict.violations
    assert (first.clause, first.other) == ("entered_while_blocked", "west")
    assert (second.clause, second.other, second.value) == ("forced_braking", "east", 4.5)
    assert (second.start_s, second.end_s) == pytest.approx((0.5, 0.8))
    # Ticks 4, 5, 6 and 8: what is no event is not counted.
    assert verdict.violating_steps == 4
