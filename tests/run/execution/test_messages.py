"""Lines between a run and its workers: what comes back is what was said, and nothing else is taken."""

from __future__ import annotations

import pytest
from run_helpers import specs

from tsbench.episode.perception_level import Perception
from tsbench.run.execution.messages import (
    TO_RUN,
    TO_WORKER,
    Finished,
    FolderFailed,
    Probe,
    Probed,
    Ready,
    Setup,
    Start,
    Task,
    decode,
    encode,
)
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet

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
    ],
)
def test_a_worker_hears_what_it_was_told(message: object) -> None:
    line = encode(message)
    assert line.count(b"\n") == 1
    assert decode(line, TO_WORKER) == message  # type: ignore[type-var]


@pytest.mark.parametrize(
    "message",
    [
        Ready(12),
        Probed(WHO),
        Probed(None, "no such planner"),
        Finished(7, RECORD),
        FolderFailed(28, "No space left on device", "/full"),
    ],
)
def test_a_run_hears_what_its_worker_said(message: object) -> None:
    assert decode(encode(message), TO_RUN) == message  # type: ignore[type-var]


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
