"""Rows of a pool that does not exist, networks that placements prepare of them, and scenes and sites on these."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simworld import CALM, FAST, simulation

from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.placement import Arrangement, SceneTask
from tsbench.make.scenes import map_scenarios as site_module
from tsbench.make.scenes.map_scenarios import MapScenarios, SiteBuilder
from tsbench.make.scenes.recipe import Recipe, Variant, load_recipe, variants_of
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.catalog import load_catalog

Networks = dict[str, RoadNetwork]


@cache
def recipe_of(type_id: str) -> Recipe:
    return load_recipe(type_id, load_catalog())


def prepared(folder: Path, type_id: str, row: PoolRow, crop: PlainNet) -> RoadNetwork:
    """A map as its type's placement prepares it."""
    net = folder / f"{type_id}{row.shape}.net.xml.gz"
    build_net(placement_of(recipe_of(type_id)).prepare(row, crop, recipe_of(type_id)), net)
    return read_network(net)


def scene_task(row: PoolRow, network: RoadNetwork, recipe: Recipe, variant: Variant, seed: int = 1) -> SceneTask:
    """One scene to arrange, among calm drivers."""
    rng = np.random.default_rng(seed)
    return SceneTask(row, network, LaneGraph(network), recipe, variant, (CALM,) * 12, rng)


def signed_half(task: SceneTask) -> Arrangement:
    return placement_of(task.recipe).place(task)


def halves_of(task: SceneTask) -> tuple[Arrangement, Arrangement]:
    """The signed half of a pair and its contrast half."""
    signed = signed_half(task)
    contrast = placement_of(task.recipe).contrast(task, signed)
    assert contrast is not None
    return signed, contrast


def built_site(
    recipe: Recipe, root: Path, made: tuple[PoolRow, PlainNet], chosen: Callable[[tuple[Variant, ...]], Any],
    prover: Any = None, split: str = "test",
) -> MapScenarios:  # fmt: skip
    """The site of a row and its crop below a folder. chosen: picks of the map's variants those that are built."""
    row, crop = made
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(site_module, "plain_crop", lambda *_: crop)
        patch.setattr(site_module, "variants_of", lambda *names: chosen(variants_of(*names)))
        return SiteBuilder(recipe, root, simulation(), prover).build(row, None, split)  # type: ignore[arg-type]


def row(
    name: str, family: str = "corridor", shape: str = "straight", *, east: float = 0.0, north: float = 0.0,
    half: float = 60.0, slot: str = "", lanes: int = 2, length: float = 220.0, speed: float = 16.67,
    tagged: bool = True, junctions: tuple[str, ...] = (), source: str = "made", road_class: str = "secondary",
    **detail: Any,
) -> PoolRow:  # fmt: skip
    return PoolRow(
        map_id=name, family=family, shape=shape, slot=slot, lat=55.7, lon=37.6, source=source, well_tagged=tagged,
        osm_ids=(1,), junction_ids=junctions, east=east, north=north, half_w=half, half_h=half, lanes=lanes,
        lane_bucket=min(lanes, 3), oneway=not detail.get("opposite"), curvature=1.0, length_m=length, speed_mps=speed,
        road_class=road_class, detail=json.dumps(detail),
    )  # fmt: skip


def corridor(name: str = "c-made-1", **more: Any) -> PoolRow:
    """The straight road of three lanes, as a corridor."""
    return row(name, **{"lanes": 3, "length": 300.0, "edge": "road", **more})


def two_way(road_class: str = "secondary", speed: float = FAST, length: float = 240.0) -> tuple[PoolRow, PlainNet]:
    """A straight road with two lanes in each direction, as a corridor, and its crop: edges `road` and `back`."""
    there = ((0.0, 0.0), (length, 0.0))
    a, b = (PlainNode(name, *at) for name, at in zip("ab", there, strict=True))
    kind = {"num_lanes": 2, "speed": speed, "priority": 9, "type": f"highway.{road_class}"}
    edges = (PlainEdge("road", "a", "b", shape=there, **kind), PlainEdge("back", "b", "a", shape=there[::-1], **kind))
    row = corridor(speed=speed, length=length, lanes=2, opposite="back", road_class=road_class)
    return row, PlainNet((a, b), edges, ())


def crossroads(name: str = "j-made-1", **more: Any) -> PoolRow:
    """The crossroads `cross` as a junction map: west-east of the higher class."""
    arms = [
        {"in_edge": f"{k}_in", "out_edge": f"{k}_out", "heading_deg": heading, "length_m": 142.0, "lanes_in": 1,
         "lanes_out": 1, "class": "secondary" if k in "we" else "residential"}
        for k, heading in {"w": 180.0, "e": 0.0, "s": -90.0, "n": 90.0}.items()
    ]  # fmt: skip
    return row(name, "junction", "X", **{"node": "x", "arms": arms, "through": [[0, 1], [2, 3]], **more})


def dual_path(name: str = "d-made-1", **more: Any) -> PoolRow:
    """The block as a dual path: left at a and round by d, c, b, or straight on; to b-u."""
    detail = {
        "signed_edge": "ta", "start_edge": "ta", "junction": "a", "destination_edge": "bu",
        "short_m": 140.0, "compliant_m": 440.0,
        "short": ["ab", "bu"], "compliant": ["ad", "dc", "cb", "bu"],
    }  # fmt: skip
    return row(name, "dual_path", "X", slot="s_l", **{**detail, **more})
