"""The benchmark's own numbers. Sources: docs/scenes.md and docs/simulation.md."""

from __future__ import annotations

TYPES = 29
# Of each type, by split, in the order in which they are built: with test alone planners can be compared already.
MAPS = {"test": 20, "dev": 5, "holdout": 10, "train": 80}
# Of each map; number 0 has no background traffic. dev is for a look in passing: it has the first two.
VARIANTS = 10
VARIANTS_OF = {split: 2 if split == "dev" else VARIANTS for split in MAPS}
TEST_PER_TRAIN = MAPS["train"] // MAPS["test"]
# Signed rows; a pair's contrast rows come on top.
ROWS = {split: TYPES * maps * VARIANTS_OF[split] for split, maps in MAPS.items()}

# From the ego: how far road users are seen, and how far plates and obstacles.
ROAD_USER_RANGE_M = 120.0
SIGN_RANGE_M = 100.0
OBSTACLE_RANGE_M = 100.0
# Arrived: the ego's centre is so near to the destination, along one of its edge's lanes.
ARRIVAL_M = 5.0
