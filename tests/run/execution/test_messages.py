"""Lines between a run and its workers: what comes back is what was said, and nothing else is taken."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from data_folder import in_force
from patience import HANG_S
from run_helpers import HERE, Bench, specs

from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.run.edition import contract_hash
from tsbench.run.execution.messages import (
    TO_RUN,
    TO_WORKER,
    Finished,
    FolderFailed,
    Limits,
    Probe,
    Probed,
    Ready,
    Refused,
    Setup,
    Start,
    Task,
    decode,
    encode,
)
from tsbench.run.execution.ray_actor import RayActor, handshake
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog

WHO = PlannerInfo("mine", "mine.py:mine", False, True, ("cuda",), None, "c0de")
RECORD = Record({"planner": "mine", "x": 0.1 + 0.2, "error": None}, [{"number": 0}], {"total_s": 1e-9}, "", "a1")


@pytest.mark.parametrize(
    "message",
    [
        Start(("/a", "")),
        Setup(
            (WHO,),
            Perception(masked=True),
            "cpu",
            "all",
            "out",
            DataSet("leeds", True),
            "test",
            "c",
            options={"most": 2},
        ),
        Probe("idm", "cuda"),
        Task(7, 0, specs()[0]),
        Ready(12),
        Probed(WHO),
        Probed(None, "no such planner"),
        Finished(7, RECORD),
        FolderFailed(28, "No space left on device", "/full"),
    ],
)
def test_what_is_said_is_what_is_heard(message: object) -> None:
    line = encode(message)
    assert line.count(b"\n") == 1
    assert decode(line, TO_WORKER if isinstance(message, TO_WORKER) else TO_RUN) == message


@pytest.mark.parametrize(
    "line",
    [
        b"", b"yyyy", b"{}", b"[]", b'["Ready"]', b'["Ready", {"pid": "12"}]', b'["Ready", {"pid": 1, "more": 2}]',
        b'["Finished", {"task": 1, "record": {"row": {}}}]', encode(Probe("idm")), b'[["Ready"], {"pid": 1}]',
    ],
)  # fmt: skip
def test_what_a_planner_writes_there_is_no_message(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"no message|Expecting|must be|unknown key|is missing"):
        decode(line, TO_RUN)


SPEC = "fake_planners:Good"


@pytest.fixture
def actor(bench: Bench) -> Iterator[RayActor]:
    with in_force(bench.data) as patch:
        patch.setattr(sys, "path", [*sys.path, str(HERE), str(HERE.parent / "metrics")])
        patch.chdir(bench.folder)
        actor = RayActor(handshake(Limits(start=HANG_S)))
        yield actor
        actor.close()


@pytest.fixture
def setup(actor: RayActor) -> Setup:
    (line,) = actor.probe([encode(Probe(SPEC))])
    planner = decode(line, (Probed,)).planner
    assert planner is not None
    contract = contract_hash(DataSet().table("test"), load_catalog())
    runner = "fake_runner:FakeRunner"
    return Setup((planner,), EXACTLY, "cpu", "all", "/nowhere", DataSet(), "test", contract, runner=runner)


def refusal(actor: RayActor, setup: Setup) -> str:
    return decode(actor.configure(encode(setup)), (Refused,)).problem


def test_an_episode_and_its_trace(actor: RayActor, setup: Setup, tmp_path: Path) -> None:
    assert actor.configure(encode(setup)) == b""
    spec = specs()[0]
    ((line, trace),) = actor.run([encode(Task(1, 0, spec))])
    finished = decode(line, (Finished,))
    assert finished.task == 1
    assert finished.record.row["scenario_id"] == spec.scenario_id
    assert finished.record.row["outcome"] == "arrived"
    assert finished.record.trace_sha256 == hashlib.sha256(trace).hexdigest()
    (tmp_path / "trace.parquet").write_bytes(trace)
    assert pq.ParquetFile(tmp_path / "trace.parquet").metadata.num_rows == 31


def test_episodes_come_back_in_the_order_in_which_they_were_asked_for(actor: RayActor, setup: Setup) -> None:
    assert actor.configure(encode(setup)) == b""
    asked = [Task(number, 0, spec) for number, spec in enumerate(specs()[:3], start=1)]
    told = actor.run([encode(task) for task in asked])
    assert [decode(line, (Finished,)).task for line, _ in told] == [1, 2, 3]
    assert len({trace for _, trace in told}) == 3


def test_a_node_with_other_data_takes_no_part(actor: RayActor, setup: Setup) -> None:
    problem = refusal(actor, replace(setup, contract="0" * 64))
    assert "its contract is" in problem
    assert "install the same tsbench and data there" in problem


def test_a_node_with_another_planner_takes_no_part(actor: RayActor, setup: Setup) -> None:
    other = replace(setup.planners[0], code_sha256="0" * 64)
    assert f"planner {SPEC} is another one there" in refusal(actor, replace(setup, planners=(other,)))
    missing = replace(other, spec="no_such_module:P")
    assert "no_such_module" in refusal(actor, replace(setup, planners=(missing,)))


def test_a_planner_that_is_none(actor: RayActor) -> None:
    (line,) = actor.probe([encode(Probe("no_such_module:P"))])
    assert "no_such_module" in decode(line, (Probed,)).problem
