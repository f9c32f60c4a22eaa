"""A run of a whole dev split, and the submission that is made of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from once import made_once
from submitted import TOWN, edition

import tsbench
from tsbench.board import claim
from tsbench.board.submission import Submission
from tsbench.run.log import read

WHO = {"title": "", "authors": "somebody", "url": "", "note": "", "third_party": False, "shared_process": True}


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    def drive(out: Path) -> None:
        tsbench.evaluate(["idm", "idm-e"], split="dev", city=TOWN, out=out / "run", workers=1)

    return made_once(tmp_path_factory, "submitted", drive) / "run"


@pytest.fixture
def released(monkeypatch: pytest.MonkeyPatch) -> str:
    """Code that was changed since the release counts as released."""
    name = edition()
    monkeypatch.setattr(read, "edition_of", lambda *_: name)
    return name


@pytest.fixture
def run(driven: Path, tmp_path: Path) -> Path:
    """A copy that may be spoilt."""
    return Path(shutil.copytree(driven, tmp_path / "run"))


@pytest.fixture
def make(run: Path, released: str) -> Callable[..., Submission]:
    def made(planner: str = "idm", **changes: object) -> Submission:
        return claim.make_submission(run, planner, **{**WHO, **changes})  # type: ignore[arg-type]

    return made


@pytest.fixture(scope="session")
def honest(driven: Path) -> Callable[..., Submission]:
    """The submissions as the run makes them, made once, with fields of one's own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(read, "edition_of", lambda *_: edition())
        made = {name: claim.make_submission(driven, name, **WHO) for name in ("idm", "idm-e")}  # type: ignore[arg-type]

    def told(planner: str, **changes: object) -> Submission:
        return replace(made[planner], **changes)  # type: ignore[arg-type]

    return told
