"""Which maps a type gets: quotas, order, distance, and a build that goes on where it stopped."""

from __future__ import annotations

import gzip
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from episode_builders import spec
from pool_builders import row

from tsbench.core import parallel
from tsbench.core.benchmark import TWO_SIGNS
from tsbench.core.parallel import Workers
from tsbench.core.provenance import closure
from tsbench.make.city import load_city
from tsbench.make.scenes import build as build_module
from tsbench.make.scenes.build import BuildRequest, TypeBuilder, TypeReport, _reason_class, build_scenarios
from tsbench.make.scenes.recipe import Recipe, load_recipe, stratum_of
from tsbench.scenarios.data_set import SPLITS, DataSet, read_table
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.store import SceneStore, store_path
from tsbench.signs.catalog import load_catalog

QUOTA = {"straight/2": 8, "straight/3": 8, "curved/2": 4, "curved/3": 4}
SPEC = replace(spec(), scenario_type="detour_right", route_length=90.0)


def recipe() -> Recipe:
    return replace(load_recipe("detour_right", load_catalog()), maps=QUOTA)


def strewn(n: int, tagged: Callable[[int], bool] = lambda _: True) -> list[PoolRow]:
    """n maps of every stratum, a kilometre apart."""
    return [
        row(f"c-{shape}-{lanes}-{k}", shape=shape, lanes=lanes, east=1000.0 * k, north=5000.0 * lanes + 99.0 * i,
            tagged=tagged(k))
        for i, shape in enumerate(("straight", "curved")) for lanes in (2, 3) for k in range(n)
    ]  # fmt: skip


class Pool:
    """Builds nothing: a site of one row with the files it names, or the reason that a map is given.

    rejected: why draws were not kept, on every map.
    """

    def __init__(self, unfit: dict[str, str] | None = None, rejected: tuple[str, ...] = ()) -> None:
        self.unfit, self.rejected, self.asked = unfit or {}, rejected, []  # type: ignore[var-annotated]

    def shutdown(self, cancel_futures: bool) -> None:
        pass

    def submit(self, _: object, recipe: Recipe, pool_row: PoolRow, split: str, request: BuildRequest) -> Any:
        name, root = pool_row.map_id, request.workplace
        self.asked.append(name)
        reason = self.unfit.get(name, "")
        files = {k: f"scenes/detour_right/{name}/{k}.gz" for k in ("net", "additional")}
        rows = [] if reason else [asdict(replace(SPEC, scenario_id=f"s-{name}", map_id=name, split=split, **files))]
        for file in files.values() if rows else ():
            (root / file).parent.mkdir(parents=True, exist_ok=True)
            (root / file).write_bytes(gzip.compress(file.encode()))
        told = {"reason": reason, "rejected": list(self.rejected)}
        return _Done({"map_id": name, "rows": rows, "certificates": [], **told})


class _Done:
    def __init__(self, value: dict[str, object]) -> None:
        self.value = value

    def result(self) -> dict[str, object]:
        return self.value


def fill(
    root: Path, rows: list[PoolRow], pool: Pool | None = None, split: str = "train", workers: int = 2
) -> tuple[list[str], dict[str, int], dict[str, int], TypeReport]:
    request = BuildRequest(DataSet(), (), root, root, workers, "")
    builder = TypeBuilder(request, recipe(), Workers(pool or Pool()), dict.fromkeys((r.map_id for r in rows), split))  # type: ignore[arg-type]
    told: list[tuple[str, int, int]] = []
    sites, report = builder.fill(rows, split, lambda *a: told.append(a))
    assert [t[1] for t in told] == list(range(1, len(sites) + 1))
    return [s.map_id for s in sites], report.maps, report.missed, report


def test_quotas_are_filled_exactly(tmp_path: Path) -> None:
    names, counts, missed, _ = fill(tmp_path, strewn(12))
    assert counts == QUOTA
    assert missed == {}
    assert len(set(names)) == 24


def test_the_test_split_gets_a_quarter(tmp_path: Path) -> None:
    _, counts, _, _ = fill(tmp_path, strewn(12), split="test")
    assert counts == {k: v // 4 for k, v in QUOTA.items()}


def test_dev_gets_one_map_of_whatever_stratum(tmp_path: Path) -> None:
    names, _, missed, _ = fill(tmp_path, strewn(12), split="dev")
    assert (len(names), missed) == (1, {})


def test_draws_that_were_not_kept_are_counted_by_reason(tmp_path: Path) -> None:
    pool = Pool({"c-curved-2-1": "unfit"}, ("one drive passes both halves", "lead of 1.2 m", "lead of 3 m"))
    *_, report = fill(tmp_path, strewn(12), pool)
    tried = 24 + sum(report.reasons.values())
    assert report.draws == {"lead of # m": 2 * tried, "one drive passes both halves": tried}


def test_a_withdrawn_map_is_not_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = strewn(12)
    before, *_ = fill(tmp_path / "a", rows)
    withdrawn = frozenset(before[:3])
    monkeypatch.setattr(build_module, "load_city", lambda _: replace(load_city("moscow"), withdrawn=withdrawn))
    names, counts, _, report = fill(tmp_path / "b", rows)
    assert not withdrawn & set(names)
    assert (counts, report.reasons) == (QUOTA, {}), "others take their place"


def test_only_maps_of_the_split(tmp_path: Path) -> None:
    rows = strewn(24)
    sides = {r.map_id: "test" if k % 2 else "train" for k, r in enumerate(rows)}
    builder = TypeBuilder(BuildRequest(DataSet(), (), tmp_path, tmp_path, 2, ""), recipe(), Workers(Pool()), sides)  # type: ignore[arg-type]
    for split in ("train", "test"):
        sites, _ = builder.fill(rows, split, lambda *_: None)
        assert {sides[s.map_id] for s in sites} == {split}


def test_well_tagged_maps_first(tmp_path: Path) -> None:
    rows = strewn(12, tagged=lambda k: k >= 6)
    names, _, _, _ = fill(tmp_path, rows)
    tagged = {r.map_id for r in rows if r.well_tagged}
    by_stratum = Counter(stratum_of(r) for r in rows if r.map_id in set(names) & tagged)
    assert by_stratum == {"straight/2": 6, "straight/3": 6, "curved/2": 4, "curved/3": 4}


def test_what_one_stratum_lacks_others_give_and_it_is_said(tmp_path: Path) -> None:
    rows = [r for r in strewn(12) if stratum_of(r) != "curved/3"][:-1]
    names, counts, missed, _ = fill(tmp_path, rows)
    assert len(names) == 24
    assert missed == {"curved/3": 4}
    assert sum(counts.values()) == 24
    assert all(counts[k] >= v for k, v in QUOTA.items() if k != "curved/3")


def test_a_pool_that_is_too_small_is_said(tmp_path: Path) -> None:
    names, _, _, report = fill(tmp_path, strewn(4))
    assert (len(names), report.short) == (16, 8)
    assert fill(tmp_path / "enough", strewn(12))[3].short == 0


def test_unfit_maps_are_passed_over_and_counted(tmp_path: Path) -> None:
    rows = strewn(12)
    unfit = {r.map_id: f"the corridor {r.map_id} is {k} m long" for k, r in enumerate(rows) if k % 4 == 0}
    names, counts, _, report = fill(tmp_path, rows, Pool(unfit))
    assert counts == QUOTA
    assert not set(names) & set(unfit)
    assert list(report.reasons) == ["the corridor # is # m long"]
    assert _reason_class("12 of scenes/a.xml: no way") == "# of no way"


def test_two_maps_of_a_type_are_sixty_metres_apart(tmp_path: Path) -> None:
    rows = strewn(12)
    twins = [replace(r, map_id=f"{r.map_id}-twin", east=r.east + 30.0) for r in rows]
    names, _, _, _ = fill(tmp_path, rows + twins)
    assert not any(f"{n}-twin" in names for n in names)


def test_neither_workers_nor_the_order_of_the_pool_matter(tmp_path: Path) -> None:
    rows = strewn(20)
    twins = [replace(r, map_id=f"{r.map_id}-twin", east=r.east + 30.0) for r in rows]
    unfit = {r.map_id: "unfit" for r in rows[::3]}
    first = fill(tmp_path / "a", rows + twins, Pool(unfit), workers=1)[:3]
    assert fill(tmp_path / "b", rows + twins, Pool(unfit), workers=7)[:3] == first
    assert fill(tmp_path / "c", [*reversed(rows), *twins], Pool(unfit))[:3] == first


def test_what_was_built_is_not_built_again(tmp_path: Path) -> None:
    rows, first, second = strewn(12), Pool({"c-straight-2-3": "too short"}), Pool()
    names = fill(tmp_path, rows, first)[0]
    assert fill(tmp_path, rows, second)[0] == names
    assert len(first.asked) >= 24
    assert second.asked == []


def test_what_changed_is_built_again(tmp_path: Path) -> None:
    rows, again = strewn(12), Pool()
    names = fill(tmp_path, rows)[0]
    changed = [replace(r, length_m=r.length_m + 1.0) if r.map_id == names[0] else r for r in rows]
    fill(tmp_path, changed, again)
    assert again.asked == [names[0]]


def test_what_a_build_writes_does_not_undo_it() -> None:
    """Certificates and tables change with each type that is ready; a build that goes on must not start again."""
    start = Path(build_module.__file__).parents[1] / "placements" / "reserved_lane_scenes.py"
    counted = closure([build_module._MAKER, start], build_module._LEFT_OUT)
    data = {name.partition(": ")[2] for name in counted if ": " in name}
    assert "sumo_nets/pool.parquet" in data
    written = {"certificates.parquet", "build_report.json", *(f"{s}.parquet" for s in SPLITS)}
    assert not {name for name in data if name.startswith("scenarios/") and Path(name).name in written}


def test_what_lost_its_files_is_built_again(tmp_path: Path) -> None:
    rows, again = strewn(12), Pool()
    names = fill(tmp_path, rows)[0]
    for file in (tmp_path / "build" / "scenes" / "detour_right" / names[0]).iterdir():
        file.unlink()
    assert fill(tmp_path, rows, again)[0] == names
    assert again.asked == [names[0]]


def test_a_build_that_was_broken_off_goes_on(tmp_path: Path) -> None:
    class Breaks(Pool):
        def submit(self, *args: Any) -> Any:
            if len(self.asked) == 15:
                raise KeyboardInterrupt
            return super().submit(*args)

    rows, rest = strewn(12), Pool()
    with pytest.raises(KeyboardInterrupt):
        fill(tmp_path, rows, Breaks())
    kept = len(list((tmp_path / "build" / "detour_right").glob("*.json")))
    assert kept > 0
    assert not list((tmp_path / "build" / "detour_right").glob("*.tmp"))
    whole = Pool()
    assert fill(tmp_path, rows, rest)[0] == fill(tmp_path / "fresh", rows, whole)[0]
    assert len(rest.asked) == len(whole.asked) - kept
    record = json.loads(next((tmp_path / "build" / "detour_right").glob("*.json")).read_text())
    assert set(record) == {"stamp", "result"}
    assert set(record["result"]) == {"map_id", "rows", "certificates", "reason", "rejected"}


def test_a_build_ends_with_tables_and_stores_the_same_bytes_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows, pools = strewn(24), [Pool(), Pool(), Pool({"c-straight-2-1": "unfit"})]
    sides = {r.map_id: "test" if k % 2 else "train" for k, r in enumerate(rows)}
    waiting = iter(pools)
    monkeypatch.setattr(build_module, "read_pool", lambda _: rows)
    monkeypatch.setattr(build_module, "split_pool", lambda *_: sides)
    monkeypatch.setattr(build_module, "load_recipes", lambda *_: [recipe()])
    monkeypatch.setattr(parallel, "ProcessPoolExecutor", lambda *_, **__: next(waiting))

    def build(root: Path) -> dict[str, bytes]:
        build_scenarios(BuildRequest(DataSet(), ("detour_right",), root, root, 2, ""), lambda *_: None)
        files = [p for p in root.rglob("*.parquet") if "build" not in p.relative_to(root).parts]
        return {p.relative_to(root).as_posix(): p.read_bytes() for p in files}

    first = build(tmp_path / "a")
    assert {name for name in first if name.startswith("scenes")} == {
        f"scenes/{split}/detour_right.parquet" for split in SPLITS if split not in TWO_SIGNS
    }
    store = SceneStore(tmp_path / "a")
    assert read_table(tmp_path / "a" / "dev.parquet") == []
    for split in ("train", "test"):
        table = read_table(tmp_path / "a" / f"{split}.parquet")
        assert {r.place for r in table} == {min(r.map_id for r in table)}, "one OSM way"
        assert len(table) == (24 if split == "train" else 6)
        named = {name for r in table for name in (r.net, r.additional)}
        assert set(store.names(split, "detour_right")) == named
        assert all(store.read(r, r.net).content == r.net.encode() for r in table)
    # Resumed, nothing is built again, and what was lost is written again.
    store_path("test", "detour_right", tmp_path / "a").unlink()
    assert build(tmp_path / "a") == first
    assert pools[1].asked == []
    # Another map, another store.
    assert build(tmp_path / "b")["scenes/test/detour_right.parquet"] != first["scenes/test/detour_right.parquet"]
