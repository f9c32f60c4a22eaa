"""Checks scenario rows: hashes, and whether each scene is what it says (docs/spec/scenes.md, "Certification", sane)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import shapely

from tsbench.core.errors import InputError
from tsbench.dataset.scenes.lint import lint_scene
from tsbench.dataset.scenes.recipe import recipe_types
from tsbench.dataset.scenes.split import APART_M, extents
from tsbench.scenarios.certificates import bases, certificates_path, read_certificates
from tsbench.scenarios.map_pool import pool_file, read_pool
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.catalog import load_catalog


def verify_rows(
    specs: Sequence[ScenarioSpec], loader: SceneLoader, progress: Callable[[int], None]
) -> list[tuple[str, str]]:
    """(scenario id, problem) of every row that is not what it says; empty if all are sound."""
    catalog = load_catalog()
    known = set(recipe_types())
    problems: list[tuple[str, str]] = []
    for k, spec in enumerate(specs):
        if spec.scenario_type not in known:
            problems.append((spec.scenario_id, f"unknown scenario type {spec.scenario_type!r}"))
        else:
            try:
                scene, roads = loader.load(spec)
                catalog.check_plates(
                    spec.sign_code, {s.id: s.code for s in scene.signs if s.role != DISTRACTOR}, "scene"
                )
                problems += [(spec.scenario_id, p) for p in lint_scene(scene, roads.graph)]
            except InputError as error:
                problems.append((spec.scenario_id, str(error)))
        progress(k + 1)
    return problems


def verify_certificates(specs: Sequence[ScenarioSpec], root: Path | None) -> list[tuple[str, str]]:
    """(scenario id, problem) of rows without a certificate, or with one that is about something else."""
    known = {c.scenario_id: c.basis for c in read_certificates(certificates_path(root))}
    problems = []
    for name, basis in bases(specs, load_catalog()).items():
        if name not in known:
            problems.append((name, "has no certificate (tsbench scenarios build makes it)"))
        elif known[name] != basis:
            problems.append(
                (
                    name,
                    "its certificate is of another row, rule or SUMO (tsbench scenarios certify renews it)",
                )
            )
    return problems


def verify_split(specs: Sequence[ScenarioSpec]) -> list[tuple[str, str]]:
    """Maps that are not in the pool, stand in both splits, or come within 300 m of a map of the other split."""
    rows = {r.map_id: r for r in read_pool(pool_file())}
    split = {s.map_id: s.split for s in specs}
    problems = [(m, "map is not in the pool") for m in sorted(set(split) - set(rows))]
    both = {s.map_id for s in specs if s.split != split[s.map_id]}
    problems += [(m, "map is in both splits") for m in sorted(both)]
    names = {side: [m for m in sorted(split) if split[m] == side and m in rows] for side in ("train", "test")}
    if names["train"] and names["test"]:
        boxes = {side: extents([rows[m] for m in ids]) for side, ids in names.items()}
        tree = shapely.STRtree(boxes["test"])
        near = tree.query(boxes["train"], predicate="dwithin", distance=APART_M - 0.5)
        problems += [
            (names["train"][a], f"is within {APART_M:.0f} m of test map {names['test'][b]}")
            for a, b in near.T
        ]
    return problems
