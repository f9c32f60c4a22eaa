"""The network's inputs as one NumPy record: what is stored for training is what is driven with.

Frame: the ego's centre, x ahead, y left. Units: m, m/s, rad, divided by the scales below.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.planners.weights import Network

Records = npt.NDArray[np.void]
Record = np.void

# Classes of object tokens; 0 is an empty slot.
EMPTY, CAR, BUS, BICYCLE, PEDESTRIAN, STATIC = range(6)
OBJECT_CLASSES = 6
OBJECTS = 30
# x, y, cos and sin of the heading, speed, length, width: an angle as one number has a seam where traffic comes from.
OBJECT_FEATURES = 7
RANGE_M = 50.0
AHEAD_FACTOR = 2.0
# To the sides for `plant2-ft`: who crosses at 60 km/h comes 67 m in the 4 s that are to be left free.
SIGN_SIDE_M = 75.0

ROUTE_POINTS = 20
ROUTE_STEP_M = 1.0
ROUTE_AHEAD_M = tuple(ROUTE_STEP_M * (k + 1) for k in range(ROUTE_POINTS))
# The road's own limit here and this much farther along the route.
LIMIT_AHEAD_M = (0.0, 30.0)

# Bird's-eye patch: drivable area, lane borders, route; row 0 is farthest ahead, column 0 farthest left.
PATCH_CHANNELS = 3
PATCH_ROWS, PATCH_COLUMNS = 64, 32
PATCH_AHEAD_M = 48.0
PATCH_M_PER_PX = 1.0

# Sign tokens (`plant2-ft`): x, y, cos and sin of the direction it faces, value, lane.
SIGNS = 6
SIGN_FEATURES = 6
# Plates that hold (`plant2-ft`), remembered once out of sight: on the ego's way, and on another arm of its junction.
# Of each: value, lane, m ahead of the ego's centre (less than 0: passed), m from its front to the end of its lane,
# and whether it has stood for the plate.
HELD = 2
HELD_FEATURES = 5

# Ways to the destination by the exits ahead (`plant2-ft`): points so far along each (x, y), then cos and sin of the
# turn at the exit, metres to it, metres to the destination, and whether it is the navigation's.
WAYS = 4
# The route's points come first: a fine-tuning begins by reading them as it reads the route's.
WAY_AHEAD_M = (*ROUTE_AHEAD_M, 25.0, 30.0, 40.0, 60.0)
WAY_FACTS = 5
WAY_FEATURES = 2 * len(WAY_AHEAD_M) + WAY_FACTS

PATH_POINTS = 20
PATH_STEP_M = 1.0
WAYPOINTS = 8
WAYPOINT_S = 0.25
FORECAST_S = (1.0, 2.0)
# Speed classes (m/s). The first gap is narrow: with one of 0 to 4 m/s, crawling and standing look the same.
SPEEDS = (0.0, 1.0, 2.5, 5.0, 8.0, 11.0, 14.0, 18.0)

POSITION_SCALE_M = 50.0
SPEED_SCALE_MPS = 10.0
LENGTH_SCALE_M, WIDTH_SCALE_M = 5.0, 2.0
REMAINING_SCALE_M = 200.0

# Without padding, which would carry whatever lay in memory into files that have to be the same.
TOKENS = np.dtype(
    [
        ("objects", np.float32, (OBJECTS, OBJECT_FEATURES)),
        ("kinds", np.uint8, (OBJECTS,)),
        ("route", np.float32, (ROUTE_POINTS, 2)),
        ("limits", np.float32, (len(LIMIT_AHEAD_M),)),
        ("patch", np.uint8, (PATCH_CHANNELS, PATCH_ROWS, PATCH_COLUMNS)),
    ]
)
SIGN_TOKENS = np.dtype(
    [
        *((name, TOKENS.fields[name][0]) for name in TOKENS.names or ()),  # type: ignore[index]
        ("signs", np.float32, (SIGNS, SIGN_FEATURES)),
        ("sign_classes", np.uint8, (SIGNS,)),
        ("held", np.float32, (HELD, HELD_FEATURES)),
        ("held_classes", np.uint8, (HELD,)),
        ("ways", np.float32, (WAYS, WAY_FEATURES)),
        ("way_known", np.uint8, (WAYS,)),
    ]
)
# What the network answers: points in the ego's frame (m), and the target speed (m/s).
PLAN = np.dtype(
    [
        ("path", np.float32, (PATH_POINTS, 2)),
        ("waypoints", np.float32, (WAYPOINTS, 2)),
        ("speed", np.float64),
        ("standing", np.float64),
    ]
)


@dataclass(frozen=True, slots=True)
class Size:
    """Extents of a network. patch: channels of the patch encoder's stages; () = tiles. dropout: of the encoder."""

    layers: int
    width: int
    heads: int
    feedforward: int
    patch: tuple[int, ...]
    hidden: int
    dropout: float


SIZES: Mapping[str, Size] = {
    "medium": Size(8, 512, 8, 2048, (64, 128, 256, 512), 128, 0.1),
    # A million parameters learn far fewer frames by heart than they are shown; drawing masks is a fifth of a step.
    "mini": Size(4, 128, 4, 512, (), 128, 0.0),
}
# What is asked of the encoder: a learned query each, in this order, before all other tokens.
PATH, WAYPOINT, SPEED, QUERIES = 0, 1, 2, 3
TILE, TILE_FEATURES = 8, 32


def size_of(base: Network) -> str:
    """A name of SIZES; InputError where the facts of some weights name none."""
    size = str(base.training.get("size", ""))
    if size not in SIZES:
        raise InputError(f"weights {base.name!r}: size {size!r}, expected {' or '.join(SIZES)}")
    return size
