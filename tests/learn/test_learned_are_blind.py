"""Masked signs change no command of a planner that has learned to drive without them."""

from __future__ import annotations

import pytest

from tsbench.episode.perception_level import Perception
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners import registry
from tsbench.scenarios.data_set import DataSet
from tsbench.sim.sumo import Simulation

BLIND = [n for n in registry.names() if registry.entry(n).weights and not registry.entry(n).sign_access]


@pytest.mark.parametrize("name", BLIND)
def test_masked_signs_change_nothing(name: str, sim: Simulation) -> None:
    row = next(r for r in DataSet().table("test") if r.scenario_type == "yield" and r.density > 0)
    commands = [
        EpisodeRunner(registry.resolve(name), perception=Perception(masked=mask), simulation=sim)
        .run(row)
        .commands.tobytes()
        for mask in (False, True)
    ]
    assert len(commands[0]) > 16 * 20
    assert commands[0] == commands[1]
