"""Dataclasses from plain values: exactly their fields, of exactly their types, or a ValueError."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import pytest

from tsbench.core.plain import dataclass_from_json


@dataclass(frozen=True)
class Inner:
    name: str
    value: float | None


@dataclass(frozen=True)
class Outer:
    count: int
    ready: bool
    inner: Inner | None
    several: tuple[Inner, ...]
    more: Mapping[str, Any]
    rows: list[dict[str, Any]]


WHOLE = Outer(
    3, True, Inner("a", None), (Inner("b", 0.1 + 0.2), Inner("c", float("inf"))), {"k": [1]}, [{"r": 1}]
)


def test_what_json_keeps_comes_back_bit_for_bit() -> None:
    assert dataclass_from_json(Outer, json.loads(json.dumps(asdict(WHOLE)))) == WHOLE


def test_numbers_that_json_lacks_may_be_text() -> None:
    assert dataclass_from_json(Inner, {"name": "a", "value": "-inf"}).value == float("-inf")
    assert isinstance(dataclass_from_json(Inner, {"name": "a", "value": 2}).value, float)


@pytest.mark.parametrize(
    "change",
    [
        {"count": True}, {"count": 1.0}, {"count": 1 << 63}, {"inner": {"name": "a", "value": 10**400}},
        {"count": "3"}, {"ready": 1}, {"inner": {"name": "a"}}, {"inner": [1]},
        {"several": {"name": "b"}}, {"several": [{"name": 1, "value": None}]}, {"more": []}, {"rows": {}}, {"new": 1},
        {"inner": {"name": "a", "value": "much"}},
    ],
)  # fmt: skip
def test_anything_else_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"expected|has the fields"):
        dataclass_from_json(Outer, {**json.loads(json.dumps(asdict(WHOLE))), **change})
