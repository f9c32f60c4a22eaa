"""Do a trace's poses follow from its commands? The ego's motion from the scene's start on, and its place on the road.

A planner runs in the process of the loop and may change it; what its commands could not have done shows here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields

from tsbench.episode.trace import Trace
from tsbench.scenarios.scene_loader import Roads
from tsbench.sim.ego import Motion, advance, start_motion
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EgoState

# One tick from a recorded state is exact but for the last bits of sine and tangent, which are the C library's.
TOLERANCE = 1e-9
_MOTION = tuple(field.name for field in fields(Motion))


def replay(trace: Trace, scene: Scene, roads: Roads) -> Iterator[str]:
    """The first tick at which a trace is not where the command of the tick before leads, and how many there are."""
    lines = []
    wanted, last = start_motion(scene), scene.network.lane(scene.start.lane).index
    for tick, snapshot in enumerate(trace.snapshots):
        ego = snapshot.ego
        if snapshot.step != tick or abs(snapshot.time - tick * DT_S) > TOLERANCE:
            yield f"tick {tick} of its trace is numbered {snapshot.step}, {snapshot.time} s"
            return
        wrong = _motion(wanted, ego, tick) or _place(ego, roads, last)
        if wrong:
            lines.append(f"tick {tick}: {wrong}")
        if tick + 1 == len(trace.snapshots):
            break
        if tick >= len(trace.commands):
            yield f"tick {tick + 1}: no command leads there"
            return
        wanted, last = advance(_motion_of(ego), *trace.commands[tick].tolist()), ego.lane
    if lines:
        yield f"its poses do not follow from its commands at {len(lines)} of {tick + 1} ticks, first {lines[0]}"


def _motion_of(ego: EgoState) -> Motion:
    return Motion(*(getattr(ego, name) for name in _MOTION))


def _motion(wanted: Motion, ego: EgoState, tick: int) -> str:
    """In what the ego's motion is another, "" if in nothing."""
    apart = math.hypot(ego.x - wanted.x, ego.y - wanted.y)
    # Written so that what is no number differs too.
    if not apart <= TOLERANCE:
        return f"{apart:.3g} m from {'where its command leads' if tick else 'the start of the scene'}"
    for name in _MOTION:
        is_, should = getattr(ego, name), getattr(wanted, name)
        if not abs(is_ - should) <= TOLERANCE:
            return f"{name} is {is_:.6g}, not {should:.6g}"
    return ""


def _place(ego: EgoState, roads: Roads, last: int) -> str:
    """In what the ego's place on the road is another than that of its pose, "" if in nothing."""
    lane, s, d, on_road = roads.locator.locate(ego.x, ego.y, ego.heading, last)
    if (lane, on_road) != (ego.lane, ego.on_road):
        return f"lane is {ego.lane} (on the road: {ego.on_road}), by its pose {lane} ({on_road})"
    if not math.hypot(ego.s - s, ego.d - d) <= TOLERANCE:
        return f"place on its lane is {ego.s:.6g}, {ego.d:.6g}, by its pose {s:.6g}, {d:.6g}"
    return ""
