"""Dataclasses from plain values: what fits comes back, and a fault says where it is and what is allowed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

from tsbench.core.errors import InputError
from tsbench.core.typed import Count, Number, Text, read_sheet, read_typed, typed


@dataclass(frozen=True)
class Inner:
    name: Text
    value: float | None
    side: Literal["left", "right"] = "left"

    def __post_init__(self) -> None:
        if self.value == 13.0:
            raise ValueError("value: is unlucky")


@dataclass(frozen=True)
class Outer:
    count: Count
    ready: bool
    inner: Inner | None
    several: tuple[Inner, ...]
    named: Mapping[str, Inner]
    more: Mapping[str, Any]
    rows: list[dict[str, Any]]
    length: Number = 1.0
    words: str | tuple[str, ...] = ()
    by_side: Mapping[Literal["left", "right"], int] | None = None


WHOLE = Outer(
    3, True, Inner("a", None), (Inner("b", 0.1 + 0.2), Inner("c", float("inf"))), {"d": Inner("d", 1.0, "right")},
    {"k": [1]}, [{"r": 1}],
)  # fmt: skip
PLAIN: dict[str, Any] = json.loads(json.dumps(asdict(WHOLE)))


def test_what_json_keeps_comes_back_bit_for_bit() -> None:
    assert typed(Outer, PLAIN) == WHOLE


def test_numbers_that_json_lacks_may_be_text_where_that_is_said() -> None:
    assert typed(Inner, {"name": "a", "value": "-inf"}, strict=False).value == float("-inf")
    assert isinstance(typed(Inner, {"name": "a", "value": 2}).value, float)


INNER = {"name": "a", "value": None}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"count": True}, "count: must be a whole number, not True"),
        ({"count": 1.0}, "count: must be a whole number, not 1.0"),
        ({"count": 0}, "count: must be a whole number >= 1, not 0"),
        ({"count": 1 << 63}, "count: must be a whole number below 2^63, not 9223372036854775808"),
        ({"count": "3"}, "count: must be a whole number, not '3'"),
        ({"inner": INNER | {"value": 10**400}}, "inner: value: "),
        ({"inner": INNER | {"value": "-inf"}}, "inner: value: must be a number or nothing, not '-inf'"),
        ({"inner": INNER | {"value": 13}}, "inner: value: is unlucky"),
        ({"inner": INNER | {"name": ""}}, "inner: name: must be text"),
        ({"inner": INNER | {"side": "up"}}, "inner: side: 'up' is none of left, right"),
        ({"inner": INNER | {"side": 1}}, "inner: side: 1 is none of left, right"),
        ({"inner": {"name": "a"}}, "inner: value: is missing"),
        ({"inner": [1]}, "inner: must be a mapping or nothing, not [1]"),
        ({"inner": INNER | {"colour": 1}}, "inner: colour: unknown key; there are name, value, side"),
        ({"ready": 1}, "ready: must be true or false, not 1"),
        ({"several": INNER}, "several: must be a list, not {"),
        ({"several": [INNER, INNER | {"name": 1}]}, "several: number 2: name: must be text, not 1 (quote codes"),
        ({"several": [INNER, INNER | {"x": 1}]}, "several: number 2: x: unknown key"),
        ({"named": {"a": INNER, "b": {}}}, "named: b: name: is missing"),
        ({"named": {"a": INNER, 7: INNER}}, "named: key 7: must be text, not 7 (quote codes and numbers)"),
        ({"more": []}, "more: must be a mapping, not []"),
        ({"more": {"k": [[10**30]]}}, "more: k: number 1: number 1: must be a whole number below 2^63"),
        ({"rows": {}}, "rows: must be a list, not {}"),
        ({"length": float("nan")}, "length: must be a number > -1e+300, not nan"),
        ({"length": float("inf")}, "length: must be a number < 1e+300, not inf"),
        ({"length": 10**400}, "length: "),
        ({"by_side": {"up": 1}}, "by_side: key 'up': 'up' is none of left, right"),
        ({"words": ["a", 1]}, "words: number 2: must be text, not 1"),
        ({"new": 1}, "new: unknown key; there are count, ready, inner, "),
    ],
)
def test_a_fault_is_told_with_its_place(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r".") as told:
        typed(Outer, {**PLAIN, **change})
    assert said in str(told.value)
    path = tmp_path / "it.json"
    path.write_text(json.dumps({**PLAIN, **change}))
    if 7 not in {**PLAIN, **change}["named"]:
        with pytest.raises(InputError) as refused:
            read_typed(Outer, path, "thing")
        assert str(refused.value) == f"{path}: {told.value}"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("schema: 1\nname: it\nvalue: 2", ""),
        ("schema: 2\nname: it\nvalue: 2", "schema: is 2, this version reads 1"),
        ("name: it\nvalue: 2", "schema: is 'missing', this version reads 1"),
        ("schema: 1\nname: that\nvalue: 2", "name: 'that' stands in the file of 'it'"),
        ("schema: 1\nname: it\nname: it\nvalue: 2", "line 3: key 'name' twice"),
        ("- 1", "must be a mapping, not [1]"),
        ("", "must be a mapping, not None"),
        ("!!python/object/apply:os.getcwd []", "could not determine a constructor"),
        ("{[a]: 1}", "unhashable key"),
        ("a: 1\n---\nb: 2", "another document"),
        ("schema: 1\nname: it\nvalue: 2001-99-99", "it.yaml: cannot be read as a sheet of the name 'it'"),
        ("schema: 1\nname: it\nvalue: 3", "value: 3 is too much"),
    ],
)
def test_a_sheet_is_named_by_a_field(content: str, said: str, tmp_path: Path) -> None:
    def meaning(inner: Inner) -> float | None:
        if inner.value == 3.0:
            raise ValueError("value: 3 is too much")
        return inner.value

    path = tmp_path / "it.yaml"
    path.write_text(content)
    if said:
        with pytest.raises(InputError, match=r"it\.yaml: ") as told:
            read_sheet(Inner, path, "name", meaning)
        assert said in str(told.value)
    else:
        assert read_sheet(Inner, path, "name", meaning) == 2.0
