"""A planner: a class with `reset` and `act`, or a function, in any file; its expert comes with it. docs/planners.md."""

from __future__ import annotations

from own_copy import Copy, records

MINE = """
from tsbench import Control, RoadAhead, pursue_route

class Careful:
    def reset(self, context):
        self.road = RoadAhead()

    def act(self, o):
        gap, lead = self.road.gap(o)
        wanted = min(self.road.speed(o), 5.0)
        return Control(min(2.0 * (wanted - o.ego.speed), lead - o.ego.speed + 0.3 * (gap - 4.0), 1.5), pursue_route(o))

def steady(o):
    return Control(0.0, pursue_route(o))
"""


def test_a_planner_is_one_class_or_function(clone: Copy) -> None:
    clone.write("mine.py", MINE)
    clone.scene("speed_limit")
    told = clone.tsbench(
        "planners check mine.py:Careful",
        "run --planner mine.py:Careful --planner mine.py:steady --planner mine.py:steady-e --split test --out run",
    )
    assert "no problems" in told
    found = records(clone.root / "run")
    assert set(found) == {"Careful", "steady", "steady-e"}
    assert found["Careful"]["scd"] is True  # 5 m/s is within any limit
    assert found["Careful"]["mean_speed"] < 6.0
    assert found["steady"]["violation_clause"] == "over_limit"
    assert (found["steady-e"]["privileged"], found["steady-e"]["sign_compliant"]) == (True, True)
