"""What stands in a run's manifest about a planner's code."""

from __future__ import annotations

import hashlib
from pathlib import Path

import tsbench.planners.idm
from tsbench.run.contestant import _code_sha256, describe


def test_our_own_planners_are_hashed_with_all_that_they_use() -> None:
    one, expert = describe("idm"), describe("idm-e")
    own = Path(str(tsbench.planners.idm.__file__))
    assert one["code_sha256"] == _code_sha256(own)
    assert one["code_sha256"] != hashlib.sha256(own.read_bytes()).hexdigest()
    # The expert has guards, which idm does not use.
    assert one["code_sha256"] != expert["code_sha256"]


def test_a_planner_of_ones_own_is_its_file(tmp_path: Path) -> None:
    file = tmp_path / "somebodys.py"
    file.write_text("from tsbench import Control\n\ndef drive(o):\n    return Control(0.0, 0.0)\n")
    assert describe(f"{file}:drive")["code_sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
