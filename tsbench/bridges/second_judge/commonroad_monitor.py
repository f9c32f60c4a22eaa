"""CommonRoad's monitor asked about one exported episode. Units: m, m/s, s.

It needs the packages of tests/bridges/commonroad/judge.lock (docs/second_judge.md).
"""

from __future__ import annotations

import math
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from tsbench.core.errors import InputError

try:
    from commonroad.common.file_reader import CommonRoadFileReader
    from crmonitor.common.scenario_type import ScenarioType
    from crmonitor.common.world import World, WorldConfig
    from crmonitor.evaluation import OfflineRuleEvaluator
    from crmonitor.evaluation.predicate_interface import PredicateEvaluationInterfaceConfig
    from crmonitor.predicates.base import PredicateConfig
except ImportError as missing:
    raise InputError(
        f"tsbench.bridges.second_judge: {missing}. It needs commonroad-stl-monitor in an environment of its own "
        "(docs/second_judge.md)"
    ) from missing

# Its stop rule knows German plates only, with the same numbers as CommonRoad's made-up country.
_COUNTRY = ("ZAM_", "DEU_")
# R_G3 reads no other plate than 274: both kinds of zones are handed over as it, with what they ask.
_LIMITS = {"274.1": "274", "325.1": "274"}
_POINT_M = 0.1
# R_IN1 of crmonitor/traffic_rules_rtamt.yaml, with a full stop of any length where it has 3 s below 5 km/h.
_ANY_STOP = (
    "((not prev (not (stop_line_in_front(a0)_i))) and (not stop_line_in_front(a0)_i) and at_traffic_sign_stop(a0)_i "
    "and (not relevant_traffic_light(a0)_i)) implies once(stop_line_in_front(a0)_i and in_standstill(a0)_i)"
)


@dataclass(frozen=True)
class Reading:
    """One way to ask a rule. rule: its name, or a formula over the monitor's predicates.

    tolerance: m/s above a limit. front: the ego is the point at its front, not its whole footprint. line_m: a stop line
    is in front within so many m. still: m/s that count as standing.
    """

    rule: str
    tolerance: float = 1e-17
    front: bool = False
    line_m: float = 1.0
    still: float = 0.01


# As published, then with what tsbench's specification has otherwise: one thing at a time, and all.
SPEED = {
    "published": Reading("R_G3"),
    "front": Reading("R_G3", front=True),
    "tolerance": Reading("R_G3", tolerance=1 / 3.6),
    "ours": Reading("R_G3", tolerance=1 / 3.6, front=True),
}
STOP = {"published": Reading("R_IN1"), "ours": Reading(_ANY_STOP, line_m=5.0, still=0.2)}


class ExportedDrive:
    """An exported episode. Raises InputError for any other file."""

    def __init__(self, path: Path) -> None:
        try:
            self._root = etree.parse(str(path)).getroot()
        except (OSError, etree.XMLSyntaxError) as problem:
            raise InputError(f"{path}: no CommonRoad scenario ({problem})") from None
        self._worlds: dict[bool, tuple[Any, int]] = {}

    def least(self, reading: Reading) -> float:
        """The rule's least robustness over the drive; below 0: violated. In m/s for speeds."""
        world, ego = self._world(reading.front)
        asked = PredicateConfig(
            scale_rob=False, eps=reading.tolerance, d_sl=reading.line_m, standstill_error=reading.still
        )
        evaluator = OfflineRuleEvaluator.create_for_rule(
            reading.rule, dt=world.dt, predicate_interface_config=PredicateEvaluationInterfaceConfig(base=asked)
        )
        return float(min(evaluator.evaluate(world, ego)))

    def _world(self, front: bool) -> tuple[Any, int]:
        if front not in self._worlds:
            with tempfile.NamedTemporaryFile(suffix=".xml") as file:
                file.write(_handed_over(self._root, front))
                file.flush()
                scenario, _ = CommonRoadFileReader(file.name).open()
            ego, *others = sorted(obstacle.obstacle_id for obstacle in scenario.dynamic_obstacles)
            # Both rules are about the ego alone.
            scenario.remove_obstacle([scenario.obstacle_by_id(other) for other in others])
            scenario.assign_obstacles_to_lanelets()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                world = World.create_from_scenario(scenario, WorldConfig(ScenarioType.INTERSECTION))
            self._worlds[front] = world, ego
        return self._worlds[front]


def _handed_over(root: Any, front: bool) -> bytes:
    """The file as the monitor is to read it."""
    scenario: Any = etree.fromstring(etree.tostring(root))
    scenario.set("benchmarkID", scenario.get("benchmarkID").replace(*_COUNTRY))
    for number in scenario.iter("trafficSignID"):
        number.text = _LIMITS.get(number.text, number.text)
    if front:
        ego = scenario.find("dynamicObstacle")
        box = ego.find("shape/rectangle")
        ahead = float(box.findtext("length")) / 2
        for side in ("length", "width"):
            box.find(side).text = str(_POINT_M)
        for state in (ego.find("initialState"), *ego.iterfind("trajectory/state")):
            heading = float(state.findtext("orientation/exact"))
            for axis, share in (("x", math.cos(heading)), ("y", math.sin(heading))):
                place = state.find(f"position/point/{axis}")
                place.text = f"{float(place.text) + ahead * share:.4f}"
    return bytes(etree.tostring(scenario))
