"""What vehicles show of what they are about to do: indicators and brake lights, tick by tick."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from types import MappingProxyType

from tsbench.episode.traffic_view import TrafficView
from tsbench.rules.monitor import Violation
from tsbench.sim.world import DT_S, Indicator, WorldSnapshot

# Who slows down by more has a foot on the brake.
_BRAKES_MPS2 = 0.8
_SIDES = MappingProxyType({Indicator.NONE: 0, Indicator.LEFT: 1, Indicator.RIGHT: -1})


def indicators(traffic_view: TrafficView, snapshot: WorldSnapshot) -> list[int]:
    """(n,) of others in their order: 1 = the left side flashes, -1 = the right side. Ticks must come in order."""
    seen = traffic_view.see(snapshot.actors, snapshot.ego)
    # The view has an order of its own: its road users are found again by where they are.
    sides = {
        (x, y): _SIDES[i] for (x, y, _), i in zip(seen.pose.tolist(), seen.indicator.tolist(), strict=True)
    }
    return [sides.get((x, y), 0) for x, y, _ in snapshot.actors.pose.tolist()]


def braking(snapshot: WorldSnapshot, before: WorldSnapshot | None) -> list[bool]:
    """(n,) of others in their order. before: the tick before; without it nobody is seen to brake."""
    actors = snapshot.actors
    then: dict[int, float] = (
        {}
        if before is None
        else dict(zip(before.actors.index.tolist(), before.actors.speed.tolist(), strict=True))
    )
    return [
        then.get(row, speed) - speed > _BRAKES_MPS2 * DT_S
        for row, speed in zip(actors.index.tolist(), actors.speed.tolist(), strict=True)
    ]


def ego_brakes(snapshot: WorldSnapshot, before: WorldSnapshot | None) -> bool:
    return before is not None and before.ego.speed - snapshot.ego.speed > _BRAKES_MPS2 * DT_S


def named_from(events: Iterable[Violation], names: Sequence[str]) -> dict[str, float]:
    """Time (s) of the first violation whose sentence names each road user."""
    found: dict[str, float] = {}
    for event in sorted(events, key=lambda e: e.start_s):
        for name in names:
            if name not in found and re.search(rf"\b{re.escape(name)}\b", event.sentence):
                found[name] = event.start_s
    return found
