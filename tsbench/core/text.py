"""Text for messages and tables, and text that comes from outside."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")
_ERROR_CHARS = 300
_MOST_CHARS = 100_000
# What a terminal obeys in place of showing it, what turns the direction of text, and halves of characters, which no
# table takes. Line ends and tabs are text.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")

_LONGEST_NAME = 200
# Of Unicode: controls, marks of direction and of width zero, private and unassigned characters, halves of characters,
# ends of lines.
_UNSEEN = ("Cc", "Cf", "Co", "Cn", "Cs", "Zl", "Zp")
# Letters, marks and symbols that show nothing.
_BLANK = re.compile("[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]")
# Scripts that stand in one word, by the first word of a letter's name in Unicode: UTS 39, "highly restrictive".
_TOGETHER = ({"LATIN", "CJK", "HIRAGANA", "KATAKANA"}, {"LATIN", "CJK", "BOPOMOFO"}, {"LATIN", "CJK", "HANGUL"})
# Cells that a spreadsheet takes for a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def one_line(text: str) -> str:
    """An error's cause on one line, without memory addresses, so that equal failures read equal.

    Characters that are no plain text are written out, as in `\\x1b`.
    """
    return written_out(_ADDRESS.sub("0x…", " ".join(text.split()))[:_ERROR_CHARS])


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """What a misspelt word may stand for, to put behind it; "" where nothing is near."""
    return "".join(f" (did you mean {name}?)" for name in get_close_matches(word, list(known), 1))


def written_out(text: str) -> str:
    """The text with characters that are no plain text as in `\\x1b`."""
    return _UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)


def fault_in_texts(value: Any) -> str:
    """What is wrong with a text in what JSON can hold, keys included; "" where all may be shown and stored."""
    left = [value]
    while left:
        one = left.pop()
        if isinstance(one, str):
            if len(one) > _MOST_CHARS:
                return f"a text of {len(one)} characters, at most {_MOST_CHARS} are allowed"
            if _UNSAFE.search(one):
                return f"control characters in the text {one_line(one):.80}"
        elif isinstance(one, dict):
            left += [*one.keys(), *one.values()]
        elif isinstance(one, list):
            left += one
    return ""


def fault_in_name(name: str) -> str:
    """What may show readers another name than this one, "" where nothing does."""
    if not name.strip() or len(name) > _LONGEST_NAME:
        return f"expected a name of 1 to {_LONGEST_NAME} characters"
    # A page shows one space where several stand, and none at an end.
    if name != name.strip(" ") or "  " in name:
        return f"{name!a}: has spaces that nobody sees"
    for character in name:
        kind = unicodedata.category(character)
        if kind in _UNSEEN or _BLANK.match(character) or (kind == "Zs" and character != " "):
            return f"{name!a}: has a character that nobody sees ({ascii(character)[1:-1]})"
        plain = unicodedata.normalize("NFKC", character)
        if len(plain) == 1 and plain != unicodedata.normalize("NFC", character) and kind[0] == "L":
            return f"{name!a}: has a letter in the form of another ({ascii(character)[1:-1]})"
    for word in re.findall(r"[^\W\d_]+", name):
        named = {unicodedata.name(letter, "?").split()[0].split("-")[0] for letter in word if letter.isalpha()}
        scripts = {"CJK" if script == "IDEOGRAPHIC" else script for script in named}
        if len(scripts) > 1 and not any(scripts <= allowed for allowed in _TOGETHER):
            return f"{name!a}: {word!a} mixes scripts ({', '.join(sorted(scripts)).lower()})"
    return ""


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Rows as CSV. Text that a spreadsheet would take for a formula has ' before it."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(_csv_cell, row) for row in rows)
    return text.getvalue()


def _csv_cell(value: object) -> object:
    if not isinstance(value, str) or not value.startswith(_FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
