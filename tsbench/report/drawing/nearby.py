"""How near somebody is to the ego at a tick, in words. Units: m, s."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from tsbench.geometry.footprint import corners
from tsbench.metrics.interaction import TTC_HORIZON_S, min_ttc
from tsbench.metrics.tracks import tracks_of
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, WorldSnapshot


def how_near(snapshot: WorldSnapshot, name: str) -> str:
    """Distance of the footprints, and the time to collision as `min_ttc` has it; "" for who is out of sight."""
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
    pair = replace(
        tracks, tick=tracks.tick[mine], row=tracks.row[mine], pose=tracks.pose[mine], kind=tracks.kind[mine],
        a_speed=tracks.a_speed[mine], length=tracks.length[mine], width=tracks.width[mine],
    )  # fmt: skip
    away, ttc = own.distance(other), min_ttc(pair)
    if away == 0.0:
        return f"{name} touches the ego"
    course = (
        f"no collision course within {TTC_HORIZON_S:.0f} s" if ttc is None else f"collision in {ttc:.1f} s"
    )
    return f"{name} {away:.1f} m away, {course}"
