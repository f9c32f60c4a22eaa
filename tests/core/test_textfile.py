"""Text from outside."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tsbench.core.errors import InputError, cause_of
from tsbench.core.text import csv_text, fault_in_name, fault_in_texts, one_line
from tsbench.core.textfile import read_json

# A terminal clears its screen, a name ends in another file type, half a character, a bell, a C1 control.
UNSAFE = ("\x1b[2J", "gnp\u202egnp", "half \ud800", "\a", "\x9b2J", "\0", "\u2066x")
SAFE = ("", "plain", "Äußerst, ёлка 漢字", "two\nlines\tand a tab", "\U0001f468\u200d\U0001f4bb", "می\u200cخواهم")


@pytest.mark.parametrize("text", UNSAFE)
def test_what_a_terminal_obeys_is_found_wherever_it_stands(text: str, tmp_path: Path) -> None:
    for value in (text, {text: 1}, {"a": [{"b": text}]}, ["x", ["y", text]]):
        assert fault_in_texts(value).startswith("control characters in the text ")
        assert all(char.isprintable() for char in fault_in_texts(value))
        path = tmp_path / "it.json"
        path.write_text(json.dumps(value))
        with pytest.raises(InputError, match="control characters in the text"):
            read_json(path, "thing")


@pytest.mark.parametrize("text", UNSAFE)
def test_an_error_is_told_with_such_characters_written_out(text: str) -> None:
    told = one_line(f"ValueError: {text}")
    assert told.isprintable()
    assert told == one_line(told)
    assert cause_of(ValueError(text)) == told


@pytest.mark.parametrize("text", SAFE)
def test_text_of_any_language_is_text(text: str, tmp_path: Path) -> None:
    assert fault_in_texts({"a": [text, 1, None, True, 0.5], text: {}}) == ""
    path = tmp_path / "it.json"
    path.write_text(json.dumps([text]))
    assert read_json(path, "thing") == [text]


def test_a_text_may_be_long_but_not_endless() -> None:
    assert fault_in_texts(["x" * 100_000]) == ""
    assert fault_in_texts(["x" * 100_001]) == "a text of 100001 characters, at most 100000 are allowed"


def test_equal_failures_read_equal() -> None:
    assert one_line("at <object at 0x7f00aa11bb22>\n  twice") == "at <object at 0x…> twice"
    assert len(one_line("x" * 1000)) == 300


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ("=HYPERLINK(1)", "'=HYPERLINK(1)"),
        ("+a", "'+a"),
        ("-", "'-"),
        ("@sum", "'@sum"),
        ("\t=1", "'\t=1"),
        ("-2.5", "-2.5"),
        ("+1e-3", "+1e-3"),
        ("-inf", "-inf"),
        ("a=b", "a=b"),
        (-3, "-3"),
        ("", '""'),
    ],
)
def test_a_table_has_no_formula(cell: object, written: str) -> None:
    assert csv_text([[cell]]) == f"{written}\n"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("id\u200bm", "nobody sees"),
        ("\u202eidm", "nobody sees"),
        ("idm\ue000", "nobody sees"),
        ("idm\u2800", "nobody sees"),
        ("idm\ufe0f", "nobody sees"),
        ("idm\u00a0", "nobody sees"),
        ("\uff49dm", "the form of another"),
        ("\u0456dm", "mixes scripts"),
        ("plan-\u03b1b", "mixes scripts"),
        (" ", "expected a name"),
    ],
)
def test_a_name_that_readers_take_for_another_is_found(name: str, said: str) -> None:
    assert said in fault_in_name(name)
    assert fault_in_name(name).isascii()


@pytest.mark.parametrize(
    "name", ["idm", "规划器v2", "プランナー々", "Планировщик", "α-planner", "สำรวจ", "계획ko", "m/s²"]
)
def test_a_name_of_any_language_is_a_name(name: str) -> None:
    assert fault_in_name(name) == ""


def test_what_is_nested_too_deep_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "it.json"
    path.write_text("[" * 50 + "]" * 50)
    read_json(path, "thing")
    path.write_text('{"a": ' * 51 + "1" + "}" * 51)
    with pytest.raises(InputError, match="more than 50 levels deep"):
        read_json(path, "thing")
