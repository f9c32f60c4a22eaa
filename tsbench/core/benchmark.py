"""The benchmark's own numbers. Sources: docs/scenes.md and docs/simulation.md."""

from __future__ import annotations

TYPES = 29
# Scenarios with two signs: splits, with the split whose places they are on.
TWO_SIGNS = {"two-signs": "test", "two-signs-dev": "dev"}
# Of each type, by split, in the order in which they are built: with test alone planners can be compared already.
MAPS = {"test": 20, "dev": 5, "holdout": 10, "train": 80, "two-signs": 20, "two-signs-dev": 1}
# Of each map; number 0 has no background traffic. dev is for a look in passing: it has the first two.
VARIANTS = 10
VARIANTS_OF = {**dict.fromkeys(MAPS, VARIANTS), "dev": 2, "two-signs": 5, "two-signs-dev": 1}
TEST_PER_TRAIN = MAPS["train"] // MAPS["test"]


def places_of_split(split: str) -> str:
    """The split whose places a split's maps are of: its own, but for those of two signs."""
    return TWO_SIGNS.get(split, split)


# Signed rows of types of one sign; a pair's contrast rows come on top.
ROWS = {split: TYPES * maps * VARIANTS_OF[split] for split, maps in MAPS.items() if split not in TWO_SIGNS}

# From the ego: how far road users are seen, and how far plates and obstacles.
ROAD_USER_RANGE_M = 120.0
SIGN_RANGE_M = 100.0
OBSTACLE_RANGE_M = 100.0
# Arrived: the ego's centre is so near to the destination, along one of its edge's lanes.
ARRIVAL_M = 5.0
