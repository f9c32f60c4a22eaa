"""The package's own planners begin each episode afresh by themselves: any order of episodes gives the same bytes.

So their episodes share a process (`run.execution.fresh_episode` is for everybody else's).
"""

from __future__ import annotations

import pytest

from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import EXPERT, is_own, names, place_of, resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

# But the second of two that are one network with other weights.
OWN = [n for n in names() if is_own(place_of(n.removesuffix(EXPERT))) and not n.endswith("-seed1")]


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    """Both halves of a pair at a junction, and a scene with another plate."""
    table = DataSet().table("dev")
    pair = next(row.pair_id for row in table if row.pair_type == "yield")
    other = next(row for row in table if row.pair_type == "speed_limit")
    return [*(row for row in table if row.pair_id == pair), other]


def told(result: EpisodeResult) -> tuple[str, str, bytes, bytes]:
    plans = b"".join(b"" if plan is None else plan.tobytes() for plan in result.plans)
    return result.outcome.value, result.error, result.commands.tobytes(), plans


@pytest.mark.parametrize("name", OWN)
def test_any_order_gives_the_same_bytes(name: str, rows: list[ScenarioSpec], sim: Simulation) -> None:
    assert resolve(name).own
    found: dict[str, set[tuple[str, str, bytes, bytes]]] = {}
    for order in (rows, rows[::-1]):
        runner = EpisodeRunner(resolve(name), simulation=sim)
        for row in order:
            result = runner.run(row)
            found.setdefault(row.scenario_id, set()).add(told(result))
    assert len(found) == 3
    # The first of each order has nothing before it, the others have.
    assert {len(results) for results in found.values()} == {1}
    assert all(result[2] for results in found.values() for result in results)
