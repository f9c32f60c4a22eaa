"""A small run that `evaluate` made of scenes of the dev split, with all traces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import tsbench


class Told:
    """A listener that writes down what it is told."""

    def __init__(self) -> None:
        self.heard: list[Any] = []

    def started(self, run: Any) -> None:
        self.heard.append(run)

    def episode(self, row: Any) -> None:
        self.heard.append(row["scenario_id"])

    def finished(self, result: Any) -> None:
        self.heard.append(result)


class Parked:
    """Of a module that workers can import."""

    def reset(self, context: tsbench.PlannerContext) -> None:
        pass

    def act(self, observation: tsbench.Observation) -> tsbench.Control:
        return tsbench.Control(-3.0, 0.0)


@pytest.fixture(scope="session")
def told() -> Told:
    return Told()


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory, told: Told) -> tsbench.Run:
    out = tmp_path_factory.mktemp("api") / "run"
    return tsbench.evaluate(
        ["idm", f"{__file__}:Parked"], split="dev", types="speed_limit", limit=2, workers=1, trace="all", out=out,
        listeners=[told],
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path
