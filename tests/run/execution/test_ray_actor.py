"""A seat of the cluster, without a cluster: JSON in, JSON and the bytes of a trace out."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from patience import HANG_S
from run_helpers import HERE, Bench, specs

from tsbench.core.paths import data_root
from tsbench.run.contract import contract_hash
from tsbench.run.execution.base import Limits
from tsbench.run.execution.factory import make_executor
from tsbench.run.execution.ray_actor import RayActor, handshake
from tsbench.run.execution.worker_process import Setup
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog

SPEC = "fake_planners:Good"


@pytest.fixture
def seat(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Iterator[RayActor]:
    monkeypatch.setenv("TSBENCH_DATA", str(bench.data))
    monkeypatch.setattr(sys, "path", [*sys.path, str(HERE), str(HERE.parent / "metrics")])
    monkeypatch.chdir(bench.folder)
    data_root.cache_clear()
    seat = RayActor(handshake(Limits(start=HANG_S)))
    yield seat
    seat.close()
    data_root.cache_clear()


@pytest.fixture
def setup(seat: RayActor) -> Setup:
    planners = json.loads(seat.probe(json.dumps([SPEC])))["planners"]
    contract = contract_hash(read_table(table_path("test")), load_catalog())
    return Setup("fake_runner:FakeRunner", tuple(planners), False, "cpu", "all", "/nowhere", "test", contract)


def told(setup: Setup) -> str:
    return json.dumps(asdict(setup))


def test_an_episode_and_its_trace(seat: RayActor, setup: Setup, tmp_path: Path) -> None:
    assert seat.configure(told(setup)) == ""
    spec = specs()[0]
    record, trace = seat.run(json.dumps({"number": 1, "planner": 0, "spec": asdict(spec)}))
    content = json.loads(record)
    assert content["row"]["scenario_id"] == spec.scenario_id
    assert content["row"]["outcome"] == "arrived"
    assert content["trace_sha256"] == hashlib.sha256(trace).hexdigest()
    (tmp_path / "trace.parquet").write_bytes(trace)
    assert pq.ParquetFile(tmp_path / "trace.parquet").metadata.num_rows == 31


def test_a_node_with_other_data_takes_no_part(seat: RayActor, setup: Setup) -> None:
    problem = seat.configure(told(replace(setup, contract="0" * 64)))
    assert "its contract is" in problem
    assert "install the same tsbench and data there" in problem


def test_a_node_with_another_planner_takes_no_part(seat: RayActor, setup: Setup) -> None:
    other = {**setup.planners[0], "code_sha256": "0" * 64}
    assert f"planner {SPEC} is another one there" in seat.configure(told(replace(setup, planners=(other,))))
    missing = {**other, "spec": "no_such_module:P"}
    assert "no_such_module" in seat.configure(told(replace(setup, planners=(missing,))))


def test_a_planner_that_is_none(seat: RayActor) -> None:
    assert "no_such_module" in json.loads(seat.probe('["no_such_module:P"]'))["problem"]


def test_executors_by_name() -> None:
    assert type(make_executor("local", 3, 2, Limits())).__name__ == "Pool"
    pytest.importorskip("ray")
    assert type(make_executor("ray", None, 2, Limits())).__name__ == "RayExecutor"
