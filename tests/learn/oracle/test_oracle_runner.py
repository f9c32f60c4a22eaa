"""Tries of one expert on one scenario, and a small collection driven, broken off and continued."""

from __future__ import annotations

import io
from dataclasses import asdict
from pathlib import Path

import pytest
from rich.console import Console

from tsbench.core.seeds import planner_seed
from tsbench.learn.oracle.collect import CollectOptions, chosen, collect, experts, first_variant
from tsbench.learn.oracle.select import select, verify
from tsbench.learn.oracle.store import read_tries
from tsbench.learn.oracle.trajectories import OracleRunner, record_of, retry_seed, unpack
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.experts.expert import Expert
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation
from tsbench.planners.registry import names, resolve
from tsbench.run.listener import ProgressWatcher
from tsbench.run.options import RunOptions
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation


class IdmExpert(Expert):
    def __init__(self) -> None:
        super().__init__(Idm())


class Lost(IdmExpert):
    """Leaves the road, always by the same way."""

    def act(self, observation: Observation) -> Control:
        """Full lock."""
        super().act(observation)
        return Control(1.0, 0.6)


class Moody(IdmExpert):
    """Leaves the road, unless its driver is a good one."""

    def reset(self, context: PlannerContext) -> None:
        """Draw the driver: one in three is good."""
        super().reset(context)
        self._good, self._haste = context.seed % 3 == 0, (context.seed % 1000) / 500

    def act(self, observation: Observation) -> Control:
        """What the driver does."""
        control = super().act(observation)
        return control if self._good else Control(self._haste, 0.6)


class Never(Moody):
    """Leaves the road, by another way each time."""

    def reset(self, context: PlannerContext) -> None:
        """No good driver is ever drawn."""
        super().reset(context)
        self._good = False


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    """Short scenes of one type."""
    return [r for r in DataSet().table("train") if r.scenario_type == "bus_lane_road"][:6]


def good(row: ScenarioSpec, attempt: int) -> bool:
    return retry_seed(planner_seed(row.pair_name), attempt) % 3 == 0


def runner(name: str, sim: Simulation, rows: list[ScenarioSpec], most: int) -> OracleRunner:
    probe = next(row for row in rows if good(row, 0) != good(row, 1))
    return OracleRunner(
        resolve(f"{__file__}:{name}"), most=most, probe=asdict(probe), simulation=sim, loader=SceneLoader(DataSet())
    )


def test_a_failed_expert_draws_another_driver_until_one_succeeds(sim: Simulation, rows: list[ScenarioSpec]) -> None:
    driven = runner("Moody", sim, rows, most=20)
    attempts = []
    for row in rows[1:]:
        wanted = next(k for k in range(20) if good(row, k))
        record = record_of(driven.run(row), privileged=True)
        tries = record.row["tries"]
        assert [t["scd"] for t in tries] == [False] * wanted + [True]
        assert [t["attempt"] for t in tries] == list(range(wanted + 1))
        assert len({t["ego"] for t in tries}) == wanted + 1
        assert len(unpack(record.row["commands"])) == tries[-1]["steps"]
        assert record.row["outcome"] == "arrived"
        attempts.append(wanted)
    assert max(attempts) > 0


@pytest.mark.parametrize(("name", "tries"), [("Lost", 1), ("Never", 3)])
def test_only_another_driver_is_worth_another_try(
    sim: Simulation, rows: list[ScenarioSpec], name: str, tries: int
) -> None:
    """Who draws nothing from the seed would drive the same again; who does ends at the bound."""
    record = record_of(runner(name, sim, rows, most=3).run(rows[1]), privileged=True)
    assert [t["scd"] for t in record.row["tries"]] == [False] * tries
    assert record.row["commands"] is None
    assert record.row["intents"] is None
    assert record.row["tries"][0]["outcome"] != "arrived"
    assert record.row["tries"][0]["comfort"] is not None


def test_experts_are_those_that_are_registered() -> None:
    assert set(experts()) == {name for name in names() if name.endswith("-e")}


def test_a_share_of_the_variants_of_each_map() -> None:
    table = DataSet().table("train")
    kinds = ("yield", "bus_lane_road")
    some = {(kind, name) for kind in kinds for name in sorted({r.map_id for r in table if r.pair_type == kind})[:15]}
    table = [r for r in table if (r.pair_type, r.map_id) in some]
    four, six = chosen(table, 4), chosen(table, 6)
    assert {r.scenario_id for r in four} < {r.scenario_id for r in six}
    assert {r.scenario_id for r in chosen(table[::-1], 4)} == {r.scenario_id for r in four}
    maps = {(r.pair_type, r.map_id) for r in table}
    assert len({r.pair_name for r in four}) == 4 * len(maps)
    # Both halves of a pair, where there are two.
    assert {r.half for r in four if r.pair_type == "yield"} == {"signed", "contrast"}
    assert all(r.scenario_id in {f.scenario_id for f in four} for r in table if r.pair_name == four[0].pair_name)
    assert chosen(table, 10) == table
    assert len({r.variant for r in four}) == 10
    # Three experts with four variants each drive all ten between them.
    lots = [first_variant(name) for name in ("ppo-e", "carl-e", "plant2-e")]
    assert sorted(lots) == [0, 3, 6]
    assert {r.scenario_id for lot in lots for r in chosen(table, 4, lot)} == {r.scenario_id for r in table}


def collected(out: Path, workers: int) -> list[str]:
    """Two experts on two scenarios; what was said meanwhile."""
    said = io.StringIO()
    request = RunOptions(("idm-e", "idm-s4-e"), "train", ("bus_lane_road",), limit=2)
    found = collect(
        DataSet(),
        CollectOptions(request=request, out=out, workers=workers),
        ProgressWatcher(Console(file=said, width=200)),
    )
    assert found.complete
    assert [(t.asked, t.solved, t.drives, t.errors) for t in found.experts.values()] == [(2, 2, 2, 0)] * 2
    return said.getvalue().splitlines()


def test_killed_and_continued_it_is_the_same(tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert collected(whole, workers=1) == []
    journal = (whole / "journal.jsonl").read_bytes().splitlines(keepends=True)
    broken.mkdir()
    manifest = (whole / "run.json").read_text()
    (broken / "run.json").write_text(manifest.replace('"complete"', '"running"'))
    (broken / "journal.jsonl").write_bytes(b"".join(journal[:2]) + journal[2][:-40])
    told = collected(broken, workers=2)
    assert any("1 torn or changed" in line for line in told)
    assert "note: continuing: 1 of 4 episodes are already there" in told
    assert (broken / "tries.parquet").read_bytes() == (whole / "tries.parquet").read_bytes()
    for folder in (whole, broken):
        found = select(DataSet(), folder, tmp_path / f"{folder.name}.parquet", allow_partial=False)
        assert (found.scenarios, found.covered, found.drives) == (2, 2, 2)
    assert (tmp_path / "whole.parquet").read_bytes() == (tmp_path / "broken.parquet").read_bytes()
    assert {t["kind"] for t in read_tries(whole)} == {"rules"}
    assert verify(DataSet(), tmp_path / "whole.parquet", "train", None) == 2
