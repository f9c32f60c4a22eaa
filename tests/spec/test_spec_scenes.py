"""docs/scenes.md against recipes, the grid of variants, the split and the committed rows."""

from __future__ import annotations

from collections import Counter

import pytest
from spec_tables import numbers, table

from tsbench.core import benchmark
from tsbench.core.seeds import ROOT_SEED
from tsbench.make.city import load_city
from tsbench.make.scenes import recipe, split
from tsbench.make.scenes.recipe import load_recipe
from tsbench.scenarios.certificates import DENSITY_TOLERANCE
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import SIGNED
from tsbench.signs.catalog import load_catalog
from tsbench.sim.nuplan import quantile

CATALOG = load_catalog()
RECIPES = {type_.id: load_recipe(type_.id, CATALOG) for type_ in CATALOG.types}


def test_the_presets_of_crosswalks() -> None:
    page = table("scenes.md", "preset", "persons")
    presets = RECIPES["crosswalk"].choices["presets"]
    assert [int(row["persons"]) for row in page] == [preset["count"] for preset in presets]
    assert [numbers(row["seconds apart"]) for row in page] == [
        [preset["gap_share"] if preset["alternate"] else preset["gap_s"]] for preset in presets
    ]


def test_the_axes_of_variants() -> None:
    axes = {row["dimension"].partition(",")[0]: numbers(row["values"]) for row in table("scenes.md", "dimension")}
    ends = [quantile(recipe.DENSITY_KEY, share) for share in recipe.DENSITY_SHARES]
    assert axes == {
        "route length after the decision point": list(recipe.ROUTE_LENGTHS_M),
        "density": ends,
        "the same": [round(density / recipe.LANE_KM_WITHIN_REACH, 1) for density in ends],
        "initial speed": [recipe.LEAST_SPEED_MPS, round(quantile(recipe.SPEED_KEY, 1.0), 2)],
        "draws of background drivers": [recipe.DRIVER_DRAWS],
        "layouts": [recipe.LAYOUTS],
        "default speed": [recipe.NOMINAL_SPEED_MPS],
    }


def test_split_and_certificate() -> None:
    assert (split.APART_M, ROOT_SEED, DENSITY_TOLERANCE) == (300.0, 42, 0.25)
    plan = load_city("moscow").split
    assert (plan.test_share, plan.tile_m) == (0.2, 2000.0)
    assert RECIPES["min_speed"].blind_baseline == "idm-s1"
    assert {recipe.blind_baseline for type_, recipe in RECIPES.items() if type_ != "min_speed"} == {"idm"}


@pytest.mark.parametrize("part", ["train", "test"])
def test_the_rows_that_there_are(part: str) -> None:
    rows = [row for row in DataSet().table(part) if row.half == SIGNED]
    assert {"train": 23_200, "test": 5_800}[part] == benchmark.ROWS[part]
    maps = {row.map_id: row for row in rows if row.pair_type == "yield"}
    assert len(maps) == benchmark.MAPS[part]
    # Of four types of routing the pool has too few places for train.
    least = {"train": 0.96, "test": 1.0}[part]
    assert least * benchmark.ROWS[part] <= len(rows) <= benchmark.ROWS[part]
    assert Counter(row.variant for row in rows) == dict.fromkeys(range(benchmark.VARIANTS), len(rows) // 10)


@pytest.mark.parametrize("part", ["train", "test"])
def test_limits_are_shared_out_as_the_page_says(part: str) -> None:
    rows = DataSet().table(part)
    limits = Counter((r.pair_type, r.sign_value) for r in rows if not r.variant and r.half == SIGNED)
    for columns in (("20", "30", "40"), ("40", "50", "60")):
        page = [row for row in table("scenes.md", "type", *columns) if row["split"] == part]
        assert page
        for row in page:
            assert [limits[row["type"], float(limit)] for limit in columns] == [int(row[c]) for c in columns]
