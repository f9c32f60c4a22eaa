"""Where every random draw comes from: a seed derived from names, never from order or time."""

from __future__ import annotations

import hashlib

import numpy as np

ROOT_SEED = 42


def seed_of(*names: object) -> int:
    """A 32-bit seed from names: the same on every machine and in every process."""
    text = "\x1f".join(str(n) for n in (ROOT_SEED, *names))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


def planner_seed(pair_name: str) -> int:
    """The seed that a planner gets, one for both halves of a pair (`ScenarioSpec.pair_name`); no row has it."""
    return seed_of("planner", pair_name)


def floor_seed(scenario_id: str) -> int:
    """What a planner gets that is a floor: one for each half, so that who throws a coin throws it anew there."""
    return seed_of("floor", scenario_id)


def rng_of(*names: object) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed_of(*names)))
