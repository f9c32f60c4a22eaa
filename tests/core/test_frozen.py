"""What planners are given can be copied and pickled: some keep what they see, and compare it later."""

from __future__ import annotations

import copy
import pickle
from dataclasses import FrozenInstanceError
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from tsbench.episode.runner import EpisodeRunner
from tsbench.geometry.polyline import Polyline
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.lane_change import pursue_route
from tsbench.planners.observation import Observation
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet


def pickled(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))  # noqa: S301  (its own pickle)


WAYS = [copy.copy, copy.deepcopy, pickled]


@pytest.mark.parametrize("copied", WAYS)
def test_a_line(copied: Any) -> None:
    line = Polyline([(0.0, 0.0), (3.0, 4.0), (3.0, 10.0)])
    other = copied(line)
    assert np.array_equal(other.points, line.points)
    assert other.length == line.length == 11.0
    assert other.project(3.0, 5.0) == line.project(3.0, 5.0)
    with pytest.raises(FrozenInstanceError):
        other.length = 3.0
    with pytest.raises(ValueError, match="read-only"):
        other.points[0] = 1.0


@pytest.mark.parametrize("copied", WAYS)
def test_a_mapping_that_nobody_writes_into(copied: Any) -> None:
    proxy = MappingProxyType({"a": MappingProxyType({"b": [1]})})
    other = copied(proxy)
    assert other == proxy
    assert type(other) is type(other["a"]) is MappingProxyType
    assert (other["a"]["b"] is proxy["a"]["b"]) == (copied is copy.copy)


class Copies:
    """Drives by what it has copied; privileged, so that it is given all there is."""

    privileged = True

    def reset(self, context: PlannerContext) -> None:
        assert context.privilege is not None
        for way in WAYS:
            other = way(context)
            assert other.destination == context.destination
            assert other.privilege.signs == context.privilege.signs
            edges = list(context.network.edges)
            routes = [(a, b) for a in edges for b in edges]
            assert [other.graph.route(*r) for r in routes] == [context.graph.route(*r) for r in routes]

    def act(self, observation: Observation) -> Control:
        seen = [way(observation) for way in WAYS]
        for other in seen:
            assert other.route.path.edges == observation.route.path.edges
            assert other.signs == observation.signs
            assert np.array_equal(other.history, observation.history)
        (control,) = {(1.0, pursue_route(other)) for other in seen}
        assert control == (1.0, pursue_route(observation))
        return Control(*control)


def test_what_a_planner_is_given() -> None:
    row = next(row for row in DataSet().table("dev") if row.pair_type == "yield")
    result = EpisodeRunner(resolve(f"{__file__}:Copies")).run(row)
    assert result.error == ""
    assert result.facts is not None
