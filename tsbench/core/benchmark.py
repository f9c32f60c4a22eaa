"""The benchmark's own numbers. Sources: docs/spec/scenes.md and docs/spec/simulation.md."""

from __future__ import annotations

TYPES = 29
# Of each type, by split; each map in so many variants, of which number 0 has no background traffic.
MAPS = {"train": 80, "test": 20}
VARIANTS = 10
TEST_PER_TRAIN = MAPS["train"] // MAPS["test"]
ROWS = {split: TYPES * maps * VARIANTS for split, maps in MAPS.items()}

# From the ego: how far road users are seen, and how far plates and obstacles.
ROAD_USER_RANGE_M = 120.0
SIGN_RANGE_M = 100.0
OBSTACLE_RANGE_M = 100.0
# Arrived: the ego's centre is so near to the destination, along one of its edge's lanes.
ARRIVAL_M = 5.0
