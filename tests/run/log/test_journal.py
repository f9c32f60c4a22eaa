"""The journal keeps what is finished, and trusts nothing else."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from run_helpers import specs

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.run.log.journal import Journal, Quarantine, decode, encode
from tsbench.run.log.record import VIOLATIONS, Record, error_row, lost_timing

EVENT = {**dict.fromkeys(VIOLATIONS.names), "number": 0, "x": 0.1 + 0.2}
KEYS = [("idm", row.scenario_id) for row in specs()]


def record(number: int) -> Record:
    row = specs()[number]
    error = error_row(row, "idm", False, Outcome.SIM_ERROR, "it broke")
    return Record(error, [EVENT], lost_timing(row, "idm", 1.5), "")


def opened(folder: Path, run: str = "this run", sound=lambda content: True) -> Journal:
    return Journal(folder / "journal.jsonl", KEYS, run, Quarantine(folder), sound)


def aside(folder: Path) -> list[bytes]:
    """What was set aside, in the order that it was."""
    found = (folder / "set_aside").glob("*-journal.jsonl")
    return [path.read_bytes() for path in sorted(found, key=lambda path: int(path.name.partition("-")[0]))]


@pytest.fixture
def full(tmp_path: Path) -> Path:
    """A folder with a journal of three episodes."""
    journal = opened(tmp_path)
    for number in range(3):
        journal.append(record(number))
    journal.close()
    return tmp_path


def test_reads_back_bit_for_bit(full: Path) -> None:
    journal = opened(full)
    assert list(journal.done) == KEYS[:3]
    for number in range(3):
        content = journal.read(KEYS[number])
        assert content["row"] == record(number).row
        assert content["events"] == [EVENT]
    assert not aside(full)
    journal.close()


@pytest.mark.parametrize("cut", [1, 2, 50, 300])
def test_a_torn_last_line_is_set_aside(full: Path, cut: int) -> None:
    path = full / "journal.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    journal = opened(full)
    assert list(journal.done) == KEYS[:2]
    third = whole.splitlines(keepends=True)[3]
    assert aside(full) == [third[:-cut]]
    journal.append(record(2))
    assert journal.read(KEYS[2])["row"] == record(2).row
    journal.close()
    assert path.read_bytes() == whole


def test_a_changed_line_in_the_middle_is_set_aside(full: Path) -> None:
    path = full / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:2], lines[2].replace(b"it broke", b"all good"), lines[3]]))
    journal = opened(full)
    assert list(journal.done) == [KEYS[0], KEYS[2]]
    assert journal.read(KEYS[2])["row"] == record(2).row
    assert b"all good" in aside(full)[0]
    journal.close()


@pytest.mark.parametrize(
    "line", [b"\n", b"rubbish\n", b"\x00" * 400, encode({"row": {"planner": "x"}}), encode({"row": []})]
)
def test_foreign_lines_are_set_aside(full: Path, line: bytes) -> None:
    with (full / "journal.jsonl").open("ab") as file:
        file.write(line)
    journal = opened(full)
    assert list(journal.done) == KEYS[:3]
    assert aside(full) == [line]
    journal.close()


def test_the_first_of_two_lines_counts(full: Path) -> None:
    path = full / "journal.jsonl"
    head, first = path.read_bytes().splitlines(keepends=True)[:2]
    path.write_bytes(path.read_bytes() + first)
    journal = opened(full)
    assert journal.done[KEYS[0]] == len(head)
    assert aside(full) == [first]
    journal.close()


def test_what_is_set_aside_is_never_overwritten(full: Path) -> None:
    for text in (b"one\n", b"two\n"):
        with (full / "journal.jsonl").open("ab") as file:
            file.write(text)
        opened(full).close()
    assert aside(full) == [b"one\n", b"two\n"]


def test_the_journal_of_another_run_is_set_aside_as_a_whole(full: Path) -> None:
    whole = (full / "journal.jsonl").read_bytes()
    journal = opened(full, "another run")
    assert not journal.done
    assert aside(full) == [whole]
    journal.append(record(0))
    journal.close()
    assert "(4 of another run)" in (full / "set_aside" / "REASONS.txt").read_text()
    assert list(opened(full, "another run").done) == KEYS[:1]


def test_an_episode_that_is_not_sound_is_run_again(full: Path) -> None:
    second = KEYS[1][1]
    journal = opened(full, sound=lambda content: content["row"]["scenario_id"] != second)
    assert list(journal.done) == [KEYS[0], KEYS[2]]
    journal.close()


@pytest.mark.parametrize("part", ["row", "timing", "events", "trace"])
def test_a_line_of_other_columns_is_foreign(full: Path, part: str) -> None:
    path = full / "journal.jsonl"
    head, first, *_ = path.read_bytes().splitlines(keepends=True)
    content = decode(first)
    if part == "trace":
        del content["trace"]
    else:
        (content[part][0] if part == "events" else content[part]).popitem()
    path.write_bytes(head + encode(content))
    journal = opened(full)
    assert not journal.done
    assert aside(full) == [encode(content)]
    journal.close()


def test_a_disk_that_takes_half_a_line(full: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The half goes again: continuing finds nothing torn."""
    write = os.write
    journal = opened(full)
    whole, writes = journal.path.read_bytes(), []

    def short(fd: int, content: bytes) -> int:
        writes.append(len(content))
        if len(writes) > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(fd, content[:40])

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", short)
        with pytest.raises(InputError, match="No space left on device; finished episodes are kept"):
            journal.append(record(3))
    assert writes[0] > writes[1] > 0
    assert journal.path.read_bytes() == whole
    assert list(journal.done) == KEYS[:3]
    journal.close()
