"""A second judge, by others: TU Munich's `commonroad-stl-monitor` over episodes exported as CommonRoad scenarios.

Its rules are published formulas (Maierhofer et al.: R_G3, speed limits, 2020; R_IN1, stop signs, 2022). It evaluates
them in signal temporal logic, from lanelets, plates and the ego's track. No line of tsbench's monitors takes part. It
needs the packages of tests/bridges/commonroad/judge.lock (docs/second_judge.md). Units: m, m/s, s.

`python -m tsbench.bridges.second_judge RUN`: agreement of both judges over a run, and what each disagreement comes
from, into RUN/second_judge.
"""

from __future__ import annotations

import math
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from lxml import etree

from tsbench.core.errors import InputError
from tsbench.core.paths import expanded
from tsbench.core.text import csv_text
from tsbench.report.analyses.analysis import markdown_row
from tsbench.report.episode_files import Selection, export_kind, select_episodes
from tsbench.run.log.read import read_run
from tsbench.run.run_traces import Traces

try:
    from commonroad.common.file_reader import CommonRoadFileReader
    from crmonitor.common.scenario_type import ScenarioType
    from crmonitor.common.world import World, WorldConfig
    from crmonitor.evaluation import OfflineRuleEvaluator
    from crmonitor.evaluation.predicate_interface import PredicateEvaluationInterfaceConfig
    from crmonitor.predicates.base import PredicateConfig
except ImportError as problem:
    _MISSING = str(problem)
else:
    _MISSING = ""

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


# By our clause: the types whose scenes ask it, and how the other judge is asked.
RULES: Mapping[str, tuple[str, tuple[str, ...], Mapping[str, Reading]]] = {
    "over_limit": ("R_G3, speed limit", ("speed_limit", "zone_speed_limit", "residential_zone"), SPEED),
    "no_full_stop": ("R_IN1, stop", ("stop",), STOP),
}
WHY = {
    "front": "the limit held for a part of the ego, not for its front: the published rule takes the footprint",
    "tolerance": "up to 1 km/h over the limit: the published rule has no tolerance",
    "ours": "both the tolerance and the footprint",
    "stop": "a full stop, but shorter than 3 s, or farther than 1 m from the line, as the published rule asks",
    "": "not explained",
}


@dataclass(frozen=True)
class Case:
    """One episode under one rule: did each judge see it broken? theirs: by reading."""

    planner: str
    scenario_id: str
    clause: str
    ours: bool
    theirs: Mapping[str, bool]

    def agrees(self, reading: str) -> bool:
        return self.theirs[reading] == self.ours

    @property
    def why(self) -> str:
        """Key of WHY: the first reading that agrees where the published one does not; "" for none."""
        found = next((name for name in self.theirs if self.agrees(name)), "")
        return "stop" if found == "ours" and self.clause == "no_full_stop" else found


def cases(run: Path, folder: Path, progress: Callable[[int, int], None]) -> Iterator[Case]:
    """Each traced episode of the types that both judge. folder: for exported files. Raises InputError."""
    types = tuple(kind for _, kinds, _ in RULES.values() for kind in kinds)
    kind, traces = export_kind("commonroad"), Traces(read_run(run))
    chosen = select_episodes(traces.run, Selection(types=types))
    for number, key in enumerate(chosen):
        progress(number, len(chosen))
        file = kind.path(folder, key)
        trace = kind.make(traces, traces.run.row("/".join(key)), file)
        drive = ExportedDrive(file)
        for clause, (_, kinds, readings) in RULES.items():
            if trace.spec.scenario_type in kinds:
                ours = any(event.clause == clause for event in trace.against)
                theirs = {name: drive.least(reading) < 0.0 for name, reading in readings.items()}
                yield Case(trace.planner, trace.spec.scenario_id, clause, ours, theirs)


def table(found: Sequence[Case]) -> str:
    """Markdown: by rule the episodes, who saw what, agreement as published and with our thresholds."""
    judged = ("both: broken", "both: kept", "only theirs", "only ours")
    head = ("rule", "episodes", *judged, "agreement", "with our thresholds")
    lines = [markdown_row(head), markdown_row(["---"] * len(head))]
    for clause, (title, _, _) in RULES.items():
        of = [case for case in found if case.clause == clause]
        if not of:
            continue
        tally = Counter((case.ours, case.theirs["published"]) for case in of)
        counts = [tally[key] for key in ((True, True), (False, False), (False, True), (True, False))]
        shares = [sum(case.agrees(name) for case in of) / len(of) for name in ("published", "ours")]
        lines.append(markdown_row([title, str(len(of)), *map(str, counts), *(f"{share:.1%}" for share in shares)]))
    return "\n".join(lines) + "\n"


def reasons(found: Sequence[Case]) -> str:
    """Markdown: every reason for disagreement with its episodes, and those that none explains by name."""
    apart = [case for case in found if not case.agrees("published")]
    head = ("rule", "disagreement", "episodes")
    lines = [markdown_row(head), markdown_row(["---"] * len(head))]
    tally = Counter((case.clause, case.why) for case in apart)
    for (clause, why), count in sorted(tally.items()):
        lines.append(markdown_row([RULES[clause][0], WHY[why], str(count)]))
    lines += [f"\nNot explained: {c.planner}/{c.scenario_id} ({c.clause})" for c in apart if not c.why]
    return "\n".join(lines) + "\n"


def rows(found: Sequence[Case]) -> list[dict[str, Any]]:
    """One plain row for each case, for a CSV."""
    return [
        {
            "planner": case.planner,
            "scenario_id": case.scenario_id,
            "clause": case.clause,
            "ours": case.ours,
            **{f"theirs_{name}": case.theirs.get(name) for name in SPEED},
            "why": "" if case.why == "published" else WHY[case.why],
        }
        for case in found
    ]


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for its files; default: RUN/second_judge.")
def main(run: Path, out: Path | None) -> None:
    """Let CommonRoad's monitor judge the speed and stop episodes of RUN (made with --trace all), and compare."""
    run = expanded(run)
    folder = run / "second_judge" if out is None else expanded(out)
    try:
        if _MISSING:
            raise InputError(
                f"tsbench.bridges.second_judge: {_MISSING}. It needs commonroad-stl-monitor in an environment of its "
                "own (docs/second_judge.md)"
            )
        found = list(cases(run, folder / "episodes", _tell))
    except InputError as problem:
        click.echo(f"error: {problem}", err=True)
        sys.exit(2)
    text = f"{table(found)}\n{reasons(found)}"
    (folder / "agreement.md").write_text(text, encoding="utf-8")
    told = rows(found)
    cells = csv_text([list(told[0]), *(list(row.values()) for row in told)])
    (folder / "agreement.csv").write_text(cells, encoding="utf-8")
    click.echo(text)


def _tell(done: int, of: int) -> None:
    click.echo(f"\r{done} of {of} episodes", nl=False, err=True)


if __name__ == "__main__":
    main()
