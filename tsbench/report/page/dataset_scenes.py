"""Scenes of a type on a map as one blob: the roads once, and what each variant puts on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context

from tsbench.report.drawing.roads import road_shapes
from tsbench.report.drawing.scene import scene_shapes
from tsbench.report.page.drawing import drawing
from tsbench.report.page.packing import pack
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec

# Scenario type and map.
Group = tuple[str, str]
# Code and value.
Plate = tuple[str, float | None]
_CHUNK = 8


def scene_blob(type_id: str, map_id: str) -> str:
    """Name of the blob of a type's scenes on a map."""
    return f"scene/{type_id}/{map_id}"


def pack_scenes(
    groups: Mapping[Group, Sequence[ScenarioSpec]], workers: int, progress: Callable[[int, int], None]
) -> Iterator[tuple[Group, bytes, set[Plate]]]:
    """Blobs in the groups' order (`roads`, and `scenes` by variant), and the plates in them."""
    with ProcessPoolExecutor(min(workers, len(groups)), mp_context=get_context("spawn")) as pool:
        packed = pool.map(_pack, groups.values(), chunksize=_CHUNK)
        for done, (key, (content, plates)) in enumerate(zip(groups, packed, strict=True), start=1):
            progress(done, len(groups))
            yield key, content, plates


@cache
def _loader() -> SceneLoader:
    return SceneLoader()


def _pack(rows: Sequence[ScenarioSpec]) -> tuple[bytes, set[Plate]]:
    scenes = {}
    plates: set[Plate] = set()
    for row in rows:
        scene, roads = _loader().load(row)
        scenes[str(row.variant)] = drawing(scene_shapes(scene, roads.graph, start=True))
        plates |= {(sign.code, sign.value) for sign in scene.signs}
    return pack({"roads": drawing(road_shapes(scene.network)), "scenes": scenes}), plates
