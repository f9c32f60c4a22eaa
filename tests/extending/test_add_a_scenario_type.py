"""A scenario type: a recipe, and signs that name it; no code where its placement is there. docs/scenes.md."""

from __future__ import annotations

import shutil

from own_copy import ROOT, Copy, records

from tsbench.scenarios.data_set import DataSet

TYPE = "tunnel_speed"
# The road of two directions that other tests build on stands for a map of the pool (argument: its name).
BUILD = """
import sys
from dataclasses import replace
from pathlib import Path
from pool_builders import two_way
from simworld import LIMIT, simulation, store_scenes
from tsbench.make.scenes import map_scenarios
from tsbench.make.scenes.recipe import load_recipe
from tsbench.scenarios.data_set import write_table
from tsbench.signs.catalog import load_catalog

row, crop = two_way(speed=LIMIT)
map_scenarios.plain_crop = lambda *_: crop
every = map_scenarios.variants_of
map_scenarios.variants_of = lambda *of: tuple(v for v in every(*of) if v.number < 2)
recipe = load_recipe("tunnel_speed", load_catalog())
built = map_scenarios.SiteBuilder(recipe, Path("built"), simulation()).build(
    replace(row, map_id=sys.argv[1]), None, "test"
)
assert not built.reason, built.reason
store_scenes(built.rows, Path("built"), Path("scenarios"))
write_table(built.rows, Path("scenarios") / "test.parquet")
"""


def test_a_scenario_type_is_a_recipe(clone: Copy) -> None:
    sign = clone.like(
        "sign_catalog/signs/4.6.yaml", ('"4.6"', '"4.6.1"'), ("id: min_speed\n  row: 8", f"id: {TYPE}\n  row: 30")
    )
    clone.write("sign_catalog/signs/4.6.1.yaml", sign)
    recipe = clone.like(
        "scenarios/recipes/min_speed.yaml", ("type: min_speed", f"type: {TYPE}"), ("paired: true\n", "")
    )
    clone.write(f"scenarios/recipes/{TYPE}.yaml", recipe)
    assert "35 signs, 30 scenario types" in clone.tsbench("signs list")

    shutil.copytree(ROOT / "tests/helpers", clone.root / "tests/helpers")
    map_id = next(row.map_id for row in DataSet().table("test") if row.scenario_type == "min_speed")
    clone.python("-c", BUILD, map_id)
    told = clone.tsbench(
        "scenarios list --split test",
        f"run --planner idm-e --planner idm-s1 --split test --types {TYPE} --variants 0 --out run",
    )
    assert told.split()[:2] == [f"{TYPE}-{map_id}-v{number}" for number in range(2)]
    found = records(clone.root / "run")
    assert (found["idm-e"]["sign_code"], found["idm-e"]["scd"]) == ("4.6.1", True)
    assert found["idm-s1"]["violation_clause"] == "under_minimum"
    assert "1 of 30 types, 2 episodes asked" in (clone.root / "run" / "summary.json").read_text()
