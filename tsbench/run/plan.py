"""What `tsbench run` was asked to do: from options to an ordered list of (planner, scenario)."""

from __future__ import annotations

import hashlib
from collections.abc import Container, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from operator import attrgetter
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.text import did_you_mean
from tsbench.run.options import BOTH, DRAWN, VARIANTS, WHICH_HALVES, RunOptions
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import known_map_ids
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import check_files
from tsbench.signs.catalog import Catalog


@dataclass(frozen=True)
class RunPlan:
    """What will be run: every planner drives every scenario.

    table: every row of the split's table, chosen or not (the contract covers them all). scenarios: the chosen
    rows, in the order of their ids. types: ids of the chosen types, in the catalogue's order.
    """

    table: tuple[ScenarioSpec, ...]
    scenarios: tuple[ScenarioSpec, ...]
    types: tuple[str, ...]


def make_plan(request: RunOptions, data: DataSet) -> RunPlan:
    """The selection. Raises InputError (one line) for whatever is asked for and not there."""
    if not request.planners:
        raise InputError("--planner: name at least one (tsbench planners list shows them)")
    twice = [p for i, p in enumerate(request.planners) if p in request.planners[:i]]
    if twice:
        raise InputError(f"--planner {twice[0]}: given twice")
    path, catalog = data.table_path(request.split), data.catalog
    types = choose_types(catalog, request.types)
    table = tuple(sorted(data.table(request.split), key=lambda row: row.scenario_id))
    _check_rows(path, table, catalog, known_map_ids(data.pool_path))
    chosen = [row for row in table if row.pair_type in types]
    present = {row.pair_type for row in chosen}
    missing = [t for t in request.types if t in types and t not in present]
    if missing or not chosen:
        raise InputError(f"{path}: has no scenario of {', '.join(missing or request.types) or 'any type'}")
    chosen = choose_half(choose_variants(chosen, request.variants), request.half)
    if not chosen:
        raise InputError(f"{path}: --half {request.half}: none of the chosen scenarios is one")
    if request.limit is not None:
        # What was drawn is not narrowed to nominal variants by a limit.
        first = _draw if request.variants in DRAWN else attrgetter("variant", "scenario_id")
        chosen = spread(sorted(chosen, key=first), types, request.limit)
    check_files(chosen, data)
    return RunPlan(table, tuple(chosen), tuple(t for t in types if t in present))


def types_and_groups(catalog: Catalog) -> list[str]:
    """What `--types` knows: ids of types, in the catalogue's order, then groups."""
    return [kind.id for kind in catalog.every_type] + sorted({kind.group for kind in catalog.every_type})


def choose_types(catalog: Catalog, asked: Sequence[str], option: str = "--types") -> tuple[str, ...]:
    """Type ids named by `asked` (ids and group names; empty = all), in the catalogue's order."""
    types, known = catalog.every_type, types_and_groups(catalog)
    for word in asked:
        if word not in known:
            groups = sorted({kind.group for kind in types})
            raise InputError(
                f"{option} {word}: no such type or group{did_you_mean(word, known)}: groups are {', '.join(groups)}; "
                f"types are {', '.join(kind.id for kind in types)}"
            )
    return tuple(kind.id for kind in types if not asked or kind.id in asked or kind.group in asked)


def choose_variants(rows: Sequence[ScenarioSpec], variants: str) -> list[ScenarioSpec]:
    """Rows of the asked variants, order kept. One pair (or row) for each type, and map, is drawn by hash."""
    if variants == "all":
        return list(rows)
    if variants == "0":
        return [row for row in rows if row.variant == 0]
    if variants not in DRAWN:
        raise InputError(f"--variants {variants}: expected {', '.join(VARIANTS)}")
    key = attrgetter(*DRAWN[variants])
    first: dict[Any, str] = {}
    for row in rows:
        first[key(row)] = min(first.get(key(row), row.pair_name), row.pair_name, key=_draw_of)
    chosen = [row for row in rows if row.pair_name == first[key(row)]]
    return sorted(chosen, key=lambda row: row.scenario_id)


def choose_half(rows: Sequence[ScenarioSpec], half: str) -> list[ScenarioSpec]:
    """Rows of the asked half, order kept; a row without a pair is a signed one."""
    if half not in WHICH_HALVES:
        raise InputError(f"--half {half}: expected {', '.join(WHICH_HALVES)}")
    return [row for row in rows if half in (BOTH, row.half)]


def _draw(row: ScenarioSpec) -> tuple[str, str]:
    """A fixed draw, the same on every machine and in every process."""
    return _draw_of(row.pair_name), row.scenario_id


def _draw_of(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()


def spread(rows: Sequence[ScenarioSpec], types: Sequence[str], limit: int) -> list[ScenarioSpec]:
    """At most `limit` rows: from the types in turn, of each the first pairs or rows: a small run touches many.

    No pair is taken in part, so there may be one row less; the first is taken whatever the limit.
    """
    if limit < 1:
        raise InputError(f"--limit {limit}: expected at least 1")
    by_type: dict[str, dict[str, list[ScenarioSpec]]] = {t: {} for t in types}
    for row in rows:
        by_type[row.pair_type].setdefault(row.pair_name, []).append(row)
    layers = zip_longest(*(pairs.values() for pairs in by_type.values()), fillvalue=[])
    chosen: list[ScenarioSpec] = []
    for pair in (pair for layer in layers for pair in layer):
        if chosen and len(chosen) + len(pair) > limit:
            break
        chosen += pair
    return sorted(chosen, key=lambda row: row.scenario_id)


def _check_rows(path: Path, rows: Sequence[ScenarioSpec], catalog: Catalog, maps: Container[str]) -> None:
    """A row may only speak of what the catalogue and the pool have."""
    kinds = {kind.id: kind for kind in catalog.every_type}
    for row in rows:
        where = f"{path}: row {row.scenario_id}"
        if row.scenario_type not in kinds:
            raise InputError(f"{where}: unknown type {row.scenario_type!r}")
        if row.sign_code not in catalog.signs:
            raise InputError(f"{where}: unknown sign {row.sign_code!r}")
        if row.map_id not in maps:
            raise InputError(f"{where}: unknown map {row.map_id!r}")
        if row.group != kinds[row.scenario_type].group:
            raise InputError(f"{where}: group {row.group!r} is not that of {row.scenario_type}")
