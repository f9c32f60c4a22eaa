"""Scenarios from Python: rows of a split, and what stands behind one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from tsbench.roads.network import RoadNetwork
from tsbench.run.plan import choose_types
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog
from tsbench.sim.scene import Scene


@dataclass(frozen=True)
class Scenario:
    """One row of a split's table. spec: the row, as in docs/scenarios.md."""

    spec: ScenarioSpec

    @property
    def id(self) -> str:
        """Its name, as `tsbench run` and tables give it."""
        return self.spec.scenario_id

    @cached_property
    def scene(self) -> Scene:
        """Plates, start, destination, obstacles, read from its files. Raises InputError where they are missing."""
        return load_scene(self.spec)

    @property
    def network(self) -> RoadNetwork:
        """Its roads, with all that plates decide; planners see less (`PlannerContext.network`)."""
        return self.scene.network


def load_scenarios(split: str = "dev", types: Sequence[str] = (), half: str = "both") -> list[Scenario]:
    """Scenarios of a split in the table's order. types: types of pairs and groups, empty = all; half: both, signed,
    contrast. Raises InputError for an unknown type or a split that is not there.
    """
    chosen = choose_types(tuple(types), load_catalog())
    rows = read_table(table_path(split))
    return [Scenario(row) for row in rows if row.pair_type in chosen and half in ("both", row.half)]
