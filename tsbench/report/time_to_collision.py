"""Time to collision and time to conflict of the ego, tick by tick as curves, and at one tick in words. Units: m, s."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from tsbench.episode.trace import Trace
from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array
from tsbench.metrics.interaction import TTC_HORIZON_S, min_ttc
from tsbench.metrics.tracks import tracks_of
from tsbench.roads.blocking import PriorityGap, arrival_s
from tsbench.roads.junction_paths import JunctionPath, junction_paths, path_zones
from tsbench.roads.priority import RULE_FOLLOWING, PriorityVehicles
from tsbench.signs.rule_kinds import GiveWayParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, WorldSnapshot


def how_near(snapshot: WorldSnapshot, name: str) -> str:
    """Distance of the footprints, and the time to collision as `min_ttc` has it; "" for a road user out of sight."""
    actors, ego = snapshot.actors, snapshot.ego
    table = actors.table
    if name not in table.ids:
        return ""
    row = table.ids.index(name)
    (place,) = np.nonzero(actors.index == row)
    if not len(place):
        return ""
    x, y, heading = actors.pose[place[0]].tolist()
    other = shapely.Polygon(corners(x, y, heading, float(table.length[row]), float(table.width[row])))
    own = shapely.Polygon(corners(ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M))
    tracks = tracks_of([snapshot])
    mine = tracks.row == row
    columns = ("tick", "row", "pose", "kind", "a_speed", "length", "width")
    pair = replace(tracks, **{name: getattr(tracks, name)[mine] for name in columns})
    away, ttc = own.distance(other), min_ttc(pair)
    if away == 0.0:
        return f"{name} touches the ego"
    course = f"no collision course within {TTC_HORIZON_S:.0f} s" if ttc is None else f"collision in {ttc:.1f} s"
    return f"{name} {away:.1f} m away, {course}"


FARTHEST_S = TTC_HORIZON_S
_NOBODY_S = FARTHEST_S + 1.0


def times_to_collision(snapshots: Sequence[WorldSnapshot]) -> Array:
    """(n,): at each tick the metric `min_ttc` of that tick alone; beyond `FARTHEST_S` where it has none."""
    found = [min_ttc(tracks_of([snapshot])) if len(snapshot.actors) else None for snapshot in snapshots]
    return np.array([_NOBODY_S if ttc is None else ttc for ttc in found])


def times_to_conflict(trace: Trace, scene: Scene) -> Array | None:
    """(n,): until the next vehicle of another arm would reach ground that the ego's path through the junction sweeps.

    As the rule to give way counts it, but of all other arms, so that both halves of a pair have the same curve: way of
    the vehicle's front to the conflict zone by its speed; 0 while it is in the zone. Beyond `FARTHEST_S` where nobody
    comes, and once the ego has left the junction. None where the target is no plate of right of way.
    """
    network = scene.network
    sign = next((sign for sign in scene.target_signs if isinstance(sign.params, GiveWayParams)), None)
    if sign is None:
        return None
    params, thresholds = sign.params_as(GiveWayParams), scene.rule(sign).thresholds
    lanes = [snapshot.ego.lane for snapshot in trace.snapshots]
    path = _driven(junction_paths(network, (params.approach,)), lanes, scene.route_hint)
    arms = sorted(
        e.id
        for e in network.edges.values()
        if e.target == params.junction and not e.internal and e.id != params.approach
    )
    others = junction_paths(network, arms)
    (zones,) = path_zones([path], others, least_overlap=thresholds["least_overlap_m"])
    vehicles, asked = PriorityVehicles(network, others, RULE_FOLLOWING), PriorityGap.of(thresholds)
    on_it = {*network.edges[params.approach].lanes, *(lane.index for lane in path.inner)}
    last = max((tick for tick, lane in enumerate(lanes) if lane in on_it), default=-1)
    found = np.full(len(lanes), _NOBODY_S)
    for tick, snapshot in enumerate(trace.snapshots[: last + 1]):
        for vehicle in vehicles.find(snapshot.actors):
            zone = zones[vehicle.path]
            if zone is None or vehicle.s - vehicle.length >= zone.b_out:
                continue
            found[tick] = min(found[tick], arrival_s(vehicle, zone, asked.least) or 0.0)
    return found


def _driven(paths: Sequence[JunctionPath], lanes: Sequence[int], hint: Sequence[str]) -> JunctionPath:
    """The path that the ego took by its lanes; if it took none, the one that navigation gave it."""
    seen = set(lanes)
    by_share = [sum(lane.index in seen for lane in path.inner) / len(path.inner) for path in paths]
    taken = [path.target.index in seen for path in paths]
    hinted = [path.target.edge in hint for path in paths]
    best = max(range(len(paths)), key=lambda k: (taken[k], by_share[k], hinted[k], -k))
    return paths[best]
