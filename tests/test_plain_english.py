"""Turns of phrase that tired a reader stay out of docstrings, comments, messages and pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import tsbench

ROOT = Path(tsbench.__file__).parent.parent
# What is said instead stands beside each.
BANNED = {
    r"\bhang(s|ing)? on (it|them|the (order|others?|path|plan|seed))\b|\bdoes not hang on\b": "depends on",
    r"\bwhoever\b": "the reader, the caller, a planner that ...",
    r"\bwhom\b": "the vehicle that ..., or an active sentence",
    r"\bbe it\b": "also, whether ... or ...",
    r"\bas good as\b": "counts as, is like",
    r"\bhangs? together\b": "are correlated",
    r"\bby lot\b": "at random, in shuffled order",
    r"\bcannot but\b": "has to",
}
# "Who imports whom" is what everybody calls such a picture.
SAID = ("Who imports whom", "who imports whom")
FILES = sorted(
    path
    for folder, kinds in (("tsbench", ("py",)), ("docs", ("md",)), (".", ("md",)))
    for kind in kinds
    for path in (ROOT / folder).glob(f"*.{kind}" if folder == "." else f"**/*.{kind}")
    if "archive" not in path.parts and path.name != "CHANGELOG.md"
)


def found_in(text: str) -> list[tuple[int, str, str]]:
    """(line, phrase, what to say instead)."""
    for words in SAID:
        text = text.replace(words, "")
    hits = [
        (text.count("\n", 0, hit.start()) + 1, hit[0], instead)
        for pattern, instead in BANNED.items()
        for hit in re.finditer(pattern, text, re.IGNORECASE)
    ]
    return sorted(hits)


def test_no_page_and_no_docstring_has_them() -> None:
    assert len(FILES) > 500
    hits = {str(path.relative_to(ROOT)): found_in(path.read_text(encoding="utf-8")) for path in FILES}
    assert {name: found for name, found in hits.items() if found} == {}


@pytest.mark.parametrize(
    ("text", "phrases"),
    [
        ("What whoever hangs on it says.", ["hangs on it", "whoever"]),
        ("A plate hangs on a post.\nThe car to whom it speaks.", ["whom"]),
        ("Its answer does not hang on\nthe batch.", ["does not hang on"]),
        ("Who imports whom: a picture.", []),
        ("Any error, be it ours.", ["be it"]),
    ],
)
def test_the_list_finds_phrases_and_leaves_plates_on_their_posts(text: str, phrases: list[str]) -> None:
    assert sorted(phrase for _, phrase, _ in found_in(text)) == sorted(phrases)
