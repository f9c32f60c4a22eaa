"""An episode in this process, tick by tick: what the planner sees, what it answers, what is held against it."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.api.evaluate import Given
from tsbench.core.errors import InputError, load
from tsbench.core.paths import expanded_text
from tsbench.core.text import did_you_mean
from tsbench.episode.episode import Episode
from tsbench.episode.outcome import EpisodeResult, Outcome
from tsbench.episode.perception_level import EXACT, EXACTLY, Perception, load_level
from tsbench.episode.trace import Trace
from tsbench.planners.base import Control, Planner, PlannerContext, Trajectory
from tsbench.planners.helpers import RoadAhead, line_ahead, sign_ahead
from tsbench.planners.observation import Observation
from tsbench.planners.registry import FunctionPlanner, resolve
from tsbench.report.wording import judged_stretch, readable, sign_name, under_other_sign
from tsbench.run.log.record import Record, make_record
from tsbench.run.options import keywords
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec, other_halves
from tsbench.sim.world import DT_S, ActorKind

_NEAREST = 6
# At most, m/s, of an ego that stands.
_STANDS_MPS = 0.1


@dataclass(frozen=True)
class _Driver:
    """A planner that was made, and how a run treats it."""

    planner: Planner
    name: str
    privileged: bool
    floor: bool


class Drive:
    """One episode, driven as `tsbench run` drives it, in this process: an exception of the planner is raised where it
    happens, so breakpoints and debuggers work.

    context: what the planner was told at the start. answer: what it returned at the tick before. One at a time: a new
    one ends the one before.
    """

    def __init__(
        self, planner: Given | Planner, row: ScenarioSpec, data: DataSet, perception: Perception = EXACTLY
    ) -> None:
        """Raises InputError for no planner and for a scene that does not load; else what the constructor raises."""
        self.row, self._data, self._loader = row, data, SceneLoader(data)
        self.answer: Control | Trajectory | None = None
        self._driver = d = _driver_of(planner)
        self._episode = Episode(
            row, planner=d.name, privileged=d.privileged, floor=d.floor, perception=perception, loader=self._loader
        )
        if self._episode.result is not None:
            raise InputError(f"{row.scenario_id}: {self._episode.result.error or self._episode.result.outcome}")
        self.context: PlannerContext = self._episode.context
        d.planner.reset(self.context)

    @property
    def planner(self) -> Planner:
        """The planner that drives."""
        return self._driver.planner

    @property
    def observation(self) -> Observation | None:
        """What the planner is shown at this tick, None once the episode is over."""
        return self._episode.observation if self._episode.result is None else None

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return len(self._episode.commands) * self.context.dt

    @property
    def outcome(self) -> str | None:
        """How it ended, None while it goes on."""
        result = self._episode.result
        return None if result is None else str(result.outcome)

    @property
    def violations(self) -> tuple[str, ...]:
        """The clauses of what is held against it so far, once per event, needless obedience included."""
        self._check_present()
        return self._episode.judged().against

    @property
    def record(self) -> dict[str, Any] | None:
        """Its row in `episodes.parquet`, None while it goes on."""
        result = self._episode.result
        return None if result is None else dict(make_record(result, self._driver.privileged).row)

    def step(self, answer: Control | Trajectory | None = None) -> bool:
        """Ask the planner, and drive one tick with what it says; False once the episode is over.

        answer: drive with this, and do not ask. Raises what the planner raises; then the same tick can be asked again.
        """
        self._check_present()
        episode = self._episode
        if episode.result is None:
            self.answer = self._driver.planner.act(episode.observation) if answer is None else answer
            episode.step(self.answer)
        return episode.result is None

    def run(self, until: float = math.inf) -> Drive:
        """Steps up to a time (s), or to the end; itself."""
        while self.outcome is None and self.time < until - self.context.dt / 2.0:
            self.step()
        return self

    def look(self) -> str:
        """What the planner is shown at this tick, in words, and what it answered at the one before."""
        self._check_present()
        seen, result = self.observation, self._episode.result
        if seen is None:
            assert result is not None
            found = make_record(result, self._driver.privileged)
            error = f": {result.error}" if result.error else ""
            passed = "passed" if found.row["scd"] else "failed"
            ended = f"Episode ended: {self.outcome} ({passed}){error}. {self._against()}"
            return "\n".join([ended, *self._why(result, found)])
        return "\n".join([*_told(seen, self.context), f"answered: {_said(self.answer)}", self._against()])

    def _why(self, result: EpisodeResult, found: Record) -> Iterator[str]:
        """Lines of what was held against the ego, what the other half's sign had made of its drive, and, where it did
        not arrive, since when it stands, before what.
        """
        if result.facts is None:
            return
        scene, ticks = result.facts.scene, result.facts.snapshots
        yield f"The sign is {sign_name(scene)}."
        for event in found.events:
            if event["target"]:
                yield readable(event["sentence"])
                if event["clause"] == "needless_slow":
                    yield judged_stretch(scene, ticks[round(event["start_s"] / DT_S)])
        if other := other_halves(self._data.table(self.row.split)).get(self.row.scenario_id):
            yield under_other_sign(scene, self._loader.load(other)[0], ticks)
        if result.outcome is Outcome.ARRIVED:
            return
        seen, context = self._episode.look(), self._episode.context
        if ticks[-1].ego.speed <= _STANDS_MPS:
            moved = max((tick.time for tick in ticks if tick.ego.speed > _STANDS_MPS), default=-DT_S)
            yield f"The ego stands since {moved + DT_S:.1f} s{_halted(seen, context)}."
        yield from _told(seen, context)

    @property
    def frame(self) -> Any:
        """The picture of the last tick, PNG (`tsbench.api.shown.Picture`)."""
        self._check_present()
        shown, paint, render = map(
            load, ("tsbench.api.shown", "tsbench.report.drawing.paint", "tsbench.report.scene_pictures")
        )
        trace, under_way = Trace.so_far(self._episode), self._episode.result is None
        scene, _ = self._loader.load(self.row)
        drawn = render.moment(trace, scene, trace.snapshots[-1].time, under_way=under_way)
        return shown.Picture(paint.png_bytes(drawn))

    def __repr__(self) -> str:
        return f"Drive({self._driver.name}/{self.row.scenario_id}, {self.outcome or 'under way'})"

    def _against(self) -> str:
        return f"Against it: {', '.join(self.violations)}." if self.violations else "No violation."

    def _check_present(self) -> None:
        if not self._episode.is_current:
            raise InputError(f"{self!r}: another episode has begun since, and this process has one at a time")


@keywords()
def drive(
    planner: Given | Planner,
    scenario: str,
    *,
    split: str | None = None,
    city: str | None = None,
    mask_signs: bool = False,
    perception: str | Path = EXACT,
) -> Drive:
    """Begin an episode in this process, to be stepped through.

    planner: as `evaluate` takes one; also a class or function of a notebook, or an object with reset and act. scenario:
    its id. split: where that is not enough. Raises InputError: no such planner or scenario, or a scene that does not
    load.
    """
    data, level = DataSet.driven(city), load_level(expanded_text(str(perception)))
    return Drive(planner, row_of(data, scenario, split), data, Perception(mask_signs, level))


def row_of(data: DataSet, scenario: str, split: str | None = None) -> ScenarioSpec:
    """The row of a scenario by its id. Raises InputError where no table, or no table of that split, has it."""
    rows = {row.scenario_id: row for name in (data.splits if split is None else (split,)) for row in data.table(name)}
    if scenario in rows:
        return rows[scenario]
    raise InputError(
        f"{scenario}: no scenario of {split or 'any split that is here'}{did_you_mean(scenario, rows)}; "
        "tsbench scenarios list names them"
    )


def _driver_of(planner: Given | Planner) -> _Driver:
    """Raises InputError for what is no planner; what its constructor raises is raised as it is."""
    if isinstance(planner, str):
        loaded = resolve(expanded_text(planner))
        return _Driver(loaded.factory(), loaded.name, loaded.privileged, loaded.floor)
    if inspect.isfunction(planner):
        made: Any = FunctionPlanner(planner)
    else:
        made = planner() if inspect.isclass(planner) else planner
    if not isinstance(made, Planner):
        raise InputError(
            f"planner: expected a name, a class, a function, or an object with reset and act: {made!r:.80}"
        )
    name = getattr(planner, "__name__", type(made).__name__)
    return _Driver(made, name, bool(getattr(made, "privileged", False)), bool(getattr(made, "floor", False)))


def _told(seen: Observation, context: PlannerContext) -> Iterator[str]:
    """Lines of what is shown. m, m/s, seconds."""
    ego, route = seen.ego, seen.route
    lane = context.network.lanes[ego.lane] if ego.lane >= 0 else None
    on = f"lane {lane.edge}_{lane.order} at {ego.s:.1f} m" if lane else "no lane"
    yield (
        f"t {seen.time:.1f} s: ego {ego.speed:.2f} m/s at ({ego.x:.1f}, {ego.y:.1f}), {on}, "
        f"{ego.d:+.2f} m beside its middle; {route.remaining:.0f} m to the destination"
    )
    for sign in seen.signs:
        value = "" if sign.value is None else f" {sign.value:g}"
        ahead = sign_ahead(seen, sign)
        where = f"{ahead:.1f} m ahead" if math.isfinite(ahead) else "not on its way"
        what = sign.code or (f"seen from behind ({sign.outline})" if sign.outline else "(masked)")
        yield f"plate {what}{value}: {where}, {sign.distance:.1f} m off, at {sign.edge or 'no road'}"
    for obstacle in seen.obstacles:
        yield f"obstacle {obstacle.id}: {math.hypot(obstacle.x - ego.x, obstacle.y - ego.y):.1f} m off"
    off = [math.hypot(x - ego.x, y - ego.y) for x, y, _ in seen.actors.pose.tolist()]
    for k in sorted(range(len(off)), key=off.__getitem__)[:_NEAREST]:
        index = int(seen.actors.lane[k])
        road = f"on {context.network.lanes[index].edge}" if index >= 0 else "off the roads"
        kind = ActorKind(int(seen.actors.kind[k])).name.lower()
        yield f"{kind}: {off[k]:.1f} m off, {float(seen.actors.speed[k]):.2f} m/s, {road}"
    if len(off) > _NEAREST:
        yield f"and {len(off) - _NEAREST} road users farther off"


def _halted(seen: Observation, context: PlannerContext) -> str:
    """Before which line an ego stands, and how far ahead something is on its path."""
    lines = [(line_ahead(context, seen, sign), sign.code) for sign in seen.signs]
    to_line, code = min((line for line in lines if line[0] >= 0.0), default=(math.inf, ""))
    gap, _ = RoadAhead().gap(seen)
    before = f", {to_line:.1f} m before the line of {code}" if math.isfinite(to_line) else ""
    return before + (f"; its path is free for {gap:.1f} m" if math.isfinite(gap) else "; nothing is on its path")


def _said(answer: Control | Trajectory | None) -> str:
    if answer is None:
        return "nothing yet"
    if isinstance(answer, Trajectory):
        return f"a trajectory of {len(answer.times)} poses, {float(answer.times[-1]):.1f} s long"
    intent = f", intent {' '.join(answer.intent)}" if answer.intent else ""
    return f"acceleration {answer.acceleration:.3f} m/s2, steering {answer.steering:.4f} rad{intent}"
