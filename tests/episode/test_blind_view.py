"""What a planner can reach is the same bytes in both halves of a pair, plates masked; and what those bytes hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from simworld import simulation

from tsbench.episode.episode import Episode
from tsbench.episode.traffic_view import blind_bytes
from tsbench.planners.base import PlannerContext
from tsbench.planners.observation import Observation
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec

PAIRS = 50
Pair = tuple[ScenarioSpec, ScenarioSpec]
Shown = tuple[PlannerContext, Observation]


@pytest.fixture(scope="module")
def pairs() -> list[Pair]:
    """Of every paired type in turn one map's first pair, then another map's."""
    rows = DataSet().table("test")
    names = {row.scenario_id: row for row in rows}
    queues: dict[str, dict[str, Pair]] = {}
    for row in rows:
        if row.pair_id and row.pair_id != row.scenario_id:
            signed = names[row.pair_id]
            queues.setdefault(signed.scenario_type, {}).setdefault(row.map_id, (signed, row))
    rounds = [list(maps.values()) for maps in queues.values()]
    return [maps[k] for k in range(max(map(len, rounds))) for maps in rounds if k < len(maps)][:PAIRS]


@pytest.fixture(scope="module")
def loader() -> SceneLoader:
    return SceneLoader(DataSet())


def first_look(loader: SceneLoader, row: ScenarioSpec, privileged: bool = False) -> Shown:
    episode = Episode(row, privileged=privileged, simulation=simulation(), loader=loader)
    return episode.context, episode.observation


def test_fifty_pairs_are_the_same_bytes_without_their_plates(loader: SceneLoader, pairs: list[Pair]) -> None:
    assert len(pairs) == PAIRS
    told = 0
    for signed, contrast in pairs:
        one, other = first_look(loader, signed), first_look(loader, contrast)
        assert blind_bytes(*one) == blind_bytes(*other), signed.scenario_id
        told += [(s.code, s.value) for s in one[1].signs] != [(s.code, s.value) for s in other[1].signs]
    assert told > PAIRS / 2  # the plates tell; of the others' none is near enough yet


def test_what_is_in_the_bytes_and_what_may_not_be(loader: SceneLoader, pairs: list[Pair]) -> None:
    context, seen = next(look for signed, _ in pairs if (look := first_look(loader, signed))[1].signs)
    same = blind_bytes(context, seen)

    def shown(**changes: Any) -> bytes:
        return blind_bytes(context, replace(seen, **changes))

    assert shown() == same
    assert shown(signs=tuple(s.masked() for s in seen.signs)) == same
    assert shown(signs=seen.signs[1:]) != same  # where posts stand is seen
    assert shown(time=seen.time + 1e-9) != same
    assert blind_bytes(replace(context, seed=context.seed + 1), seen) != same
    assert shown(ego=replace(seen.ego, speed=np.nextafter(seen.ego.speed, np.inf))) != same
    writable = np.array(seen.history)
    with pytest.raises(TypeError, match=r"history.*written into"):
        shown(history=writable)
    view = writable[:]
    view.flags.writeable = False  # but what it shows can be written
    with pytest.raises(TypeError, match="written into"):
        shown(history=view)
    with pytest.raises(TypeError, match="dict can be written into"):
        shown(obstacles=({"a": 1},))
    for role in ("convoy_0", "walker_1", "scenes/x/net.net.xml.gz"):
        with pytest.raises(ValueError, match="names a part"):
            shown(obstacles=(role,))
    with pytest.raises(ValueError, match="expert"):
        blind_bytes(*first_look(loader, pairs[0][0], privileged=True))
