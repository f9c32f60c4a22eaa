"""What a run is told of its planners before it drives."""

from __future__ import annotations

import pytest

from tsbench.core.errors import InputError
from tsbench.run.planner_info import PlannerInfo
from tsbench.run.session import distinct


def called(name: str, spec: str) -> PlannerInfo:
    return PlannerInfo(name, spec, False, True, (), None, None)


def test_names_in_records_are_distinct_and_seen() -> None:
    plain = [called("idm", "idm"), called("规划器", "a.py:规划器")]
    assert distinct(plain) == tuple(plain)
    with pytest.raises(InputError, match=r"--planner b.py:idm: called idm in records, like idm: rename one"):
        distinct([*plain, called("idm", "b.py:idm")])
    with pytest.raises(InputError, match=r"--planner b.py:X: its name: .* mixes scripts .*: rename it"):
        distinct([*plain, called("\u0456dm", "b.py:X")])
