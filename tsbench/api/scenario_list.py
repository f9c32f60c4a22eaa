"""Scenarios of the data set, one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from tsbench.core.errors import InputError, load
from tsbench.roads.road_map import RoadMap
from tsbench.run.options import keywords, text, type_words
from tsbench.run.plan import choose_types
from tsbench.scenarios.data_set import SPLITS, DataSet
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import Scene


@dataclass(frozen=True)
class Scenario:
    """A row of a split's table with its scene, which is read when it is asked for."""

    row: ScenarioSpec
    _loader: SceneLoader = field(repr=False, compare=False)

    @property
    def scenario_id(self) -> str:
        return self.row.scenario_id

    @cached_property
    def _loaded(self) -> tuple[Scene, Roads]:
        return self._loader.load(self.row)

    @property
    def scene(self) -> Scene:
        """All that does not move, plates and plans included: more than a planner is told."""
        return self._loaded[0]

    @property
    def network(self) -> RoadMap:
        """The map as planners get it."""
        return self._loaded[1].view.map

    def _repr_png_(self) -> bytes:
        paint, render = load("tsbench.report.drawing.paint"), load("tsbench.report.scene_pictures")
        picture: bytes = paint.png_bytes(render.scene_picture(self.scene, self.scenario_id, map_id=self.row.map_id))
        return picture


@keywords()
def load_scenarios(
    split: str = "test", types: str | Sequence[str] | None = None, *, city: str | None = None
) -> tuple[Scenario, ...]:
    """The scenarios of a split, in its table's order. types: ids and groups of types; None: all.

    Raises InputError for an unknown split or type, and where the split is not here.
    """
    if split not in SPLITS:
        raise InputError(f"split {split!r}: expected {', '.join(SPLITS)}")
    data = DataSet.driven(None if city is None else text("city", city))
    wanted, loader = choose_types(data.catalog, type_words("types", types)), SceneLoader(data)
    return tuple(Scenario(row, loader) for row in data.table(split) if row.pair_type in wanted)
