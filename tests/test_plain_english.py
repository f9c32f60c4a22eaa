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
# Words of a sentence, `code` counted as one; a colon or a semicolon ends it, too.
MOST_WORDS = 25
# "Who imports whom" is what everybody calls such a picture.
SAID = ("Who imports whom", "who imports whom")
FILES = sorted(
    path
    for folder, kinds in (("tsbench", ("py",)), ("docs", ("md",)), (".", ("md",)))
    for kind in kinds
    for path in (ROOT / folder).glob(f"*.{kind}" if folder == "." else f"**/*.{kind}")
    if "archive" not in path.parts and path.name != "CHANGELOG.md"
)

_NOT_PROSE = re.compile(r"```.*?```|<!--.*?-->|^[ \t]*\|.*?$", re.MULTILINE | re.DOTALL)
_ITEM = re.compile(r"\n\s*\n|\n\s*(?:[*-]|\d+\.)\s")
_END = re.compile(r"(?<=[.!?])[\"')]*\s+(?=[A-Z\"(*\d])|(?<=[;:])\s")


def long_sentences(page: str) -> list[str]:
    """Sentences of a page in Markdown that are too long, tables and code left out."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", _NOT_PROSE.sub("", page))
    text = re.sub(r"`[^`]*`", "Code", text).replace("**", "")
    sentences = [one for item in _ITEM.split(text) for one in _END.split(" ".join(item.split()))]
    return [one for one in sentences if len(one.split()) > MOST_WORDS]


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


def test_no_sentence_of_a_page_is_long() -> None:
    # What pages of signs say comes from the catalogue, whose every word is part of an edition's contract.
    pages = [path for path in FILES if path.suffix == ".md" and path.parent.name != "signs"]
    assert len(pages) > 50
    found = {str(path.relative_to(ROOT)): long_sentences(path.read_text(encoding="utf-8")) for path in pages}
    assert {name: long for name, long in found.items() if long} == {}


def test_only_what_is_read_as_one_sentence_is_counted() -> None:
    words = " ".join(["word"] * 20)
    assert long_sentences(f"A {words}. B {words}; c {words}:\n\n* **D.** E {words}\n* F {words}") == []
    assert long_sentences(f"```\n{words} {words}\n```\n| {words} {words} |\n") == []
    assert long_sentences(f"`{words} {words}` and [it](a {words}) {words}.") == []
    assert long_sentences(f"A {words}, {words}.") == [f"A {words}, {words}."]
