"""One inference process for all workers: the same bytes as a network in each of them."""

from __future__ import annotations

import os
import subprocess
import sys
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S
from run_helpers import HERE

from tsbench.core.errors import InputError
from tsbench.run.execution.inference_client import InferenceClient, InferenceServer
from tsbench.run.execution.inference_server import FINE, PROBLEM, ModelServer

TSBENCH = str(Path(sys.executable).with_name("tsbench"))
PLANNER = f"{HERE / 'served_planner.py'}:Steady"


def run(tmp_path: Path, name: str, workers: int, expect: int = 0, limit: int = 6, **more: str) -> Path:
    out = tmp_path / name
    arguments = [
        "--planner",
        PLANNER,
        "--split",
        "test",
        "--types",
        "yield",
        "--limit",
        str(limit),
        "--trace",
        "none",
    ]
    done = subprocess.run(
        [TSBENCH, "run", *arguments, "--workers", str(workers), "--out", str(out)],
        env={**os.environ, "SERVED_LOG": str(tmp_path / f"{name}.log"), **more},
        capture_output=True, text=True, timeout=HANG_S,
    )  # fmt: skip
    assert done.returncode == expect, done.stderr
    return out


def made(tmp_path: Path, name: str) -> list[str]:
    return (tmp_path / f"{name}.log").read_text().split()


@pytest.mark.slow
def test_served_or_not_gives_the_same_bytes(tmp_path: Path) -> None:
    alone, served = run(tmp_path, "alone", 1), run(tmp_path, "served", 3)
    assert set(made(tmp_path, "alone")) == {"own"}
    # Whether it can be made at all is asked of one of its own.
    assert made(tmp_path, "served")[0] == "own"
    assert set(made(tmp_path, "served")[1:]) == {"served"}
    # Who waits for answers leaves a core to others: more workers than cores that may be used.
    assert len(made(tmp_path, "served")[1:]) > 3
    for name in ("episodes.parquet", "violations.parquet"):
        assert (alone / name).read_bytes() == (served / name).read_bytes()


def test_a_network_that_does_not_load_is_refused_before_the_first_episode(tmp_path: Path) -> None:
    assert not run(tmp_path, "broken", 2, expect=2, SERVED_BROKEN="1").exists()


@pytest.mark.slow
def test_an_inference_process_that_keeps_dying_ends_the_run(tmp_path: Path) -> None:
    # More episodes than two deaths can take along: each episode has two tries.
    run(tmp_path, "dying", 2, expect=2, limit=40, SERVED_DIES="1")


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SERVED_LOG", str(tmp_path / "log"))
    server = InferenceServer("cpu")
    yield server
    server.close()


def test_a_line_answers_record_by_record(server: InferenceServer) -> None:
    from served_planner import Steady

    line = InferenceClient(server.address, PLANNER, Steady.outputs)
    records = np.zeros(3, dtype=Steady.inputs)
    records["state"][:, 0] = [1.0, 2.0, 3.0]
    assert line(records)["acceleration"].tolist() == [7.0, 6.0, 5.0]


def test_a_record_that_breaks_the_network_costs_its_own_episode_only(server: InferenceServer) -> None:
    from served_planner import Steady

    one, other = (InferenceClient(server.address, PLANNER, Steady.outputs) for _ in range(2))
    good, bad = (np.array([([4.0, t],)], dtype=Steady.inputs) for t in (0.0, -1.0))
    with pytest.raises(InputError, match=r"its network broke: ArithmeticError: before the beginning"):
        one(bad)
    assert other(good)["acceleration"] == one(good)["acceleration"] == 4.0


def test_of_a_batch_only_the_broken_record_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from served_planner import Steady

    monkeypatch.setenv("SERVED_LOG", str(tmp_path / "log"))
    records = np.array([([s, t],) for s, t in ((1.0, 0.0), (2.0, -1.0), (3.0, 0.0))], dtype=Steady.inputs)
    ends = [Pipe() for _ in records]
    ModelServer(PLANNER, "cpu").answer(
        [(there, r.tobytes()) for (_, there), r in zip(ends, records, strict=True)]
    )
    answers = [here.recv_bytes() for here, _ in ends]
    assert [answer[:1] for answer in answers] == [FINE, PROBLEM, FINE]
    assert [np.frombuffer(answers[k][1:])[0] for k in (0, 2)] == [7.0, 5.0]


def test_a_planner_without_network_is_refused(server: InferenceServer) -> None:
    with pytest.raises(InputError, match="no network that could be served"):
        InferenceClient(server.address, "idm", np.dtype(np.float64))
    with pytest.raises(InputError, match="no network that could be served"):
        ModelServer("idm", "cpu")
