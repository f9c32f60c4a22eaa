"""The journal keeps what is finished, and trusts nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from run_helpers import specs

from tsbench.errors import InputError
from tsbench.metrics.outcome import Outcome
from tsbench.run.journal import Journal, decode, encode
from tsbench.run.record import Record, error_row, lost_timing, one_line

KEYS = [("idm", row.scenario_id) for row in specs()]


def record(number: int) -> Record:
    row = specs()[number]
    error = error_row(row, "idm", False, Outcome.SIM_ERROR, "it broke")
    return Record(error, [{"number": 0, "x": 0.1 + 0.2}], lost_timing(row, "idm", 1.5), "")


def opened(folder: Path) -> Journal:
    return Journal(folder / "journal.jsonl", KEYS, folder / "aside")


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
        assert content["events"] == [{"number": 0, "x": 0.1 + 0.2}]
    assert journal.set_aside is None
    journal.close()


@pytest.mark.parametrize("cut", [1, 2, 50, 300])
def test_a_torn_last_line_is_set_aside(full: Path, cut: int) -> None:
    path = full / "journal.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    journal = opened(full)
    assert list(journal.done) == KEYS[:2]
    assert journal.set_aside is not None
    third = whole.splitlines(keepends=True)[2]
    assert journal.set_aside.read_bytes() == third[:-cut]
    journal.append(record(2))
    assert journal.read(KEYS[2])["row"] == record(2).row
    journal.close()
    assert path.read_bytes() == whole


def test_a_changed_line_in_the_middle_is_set_aside(full: Path) -> None:
    path = full / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[1].replace(b"it broke", b"all good") + lines[2])
    journal = opened(full)
    assert list(journal.done) == [KEYS[0], KEYS[2]]
    assert journal.read(KEYS[2])["row"] == record(2).row
    assert b"all good" in journal.set_aside.read_bytes()
    journal.close()


@pytest.mark.parametrize(
    "line", [b"\n", b"rubbish\n", b"\x00" * 400, encode({"row": {"planner": "x"}}), encode({"row": []})]
)
def test_foreign_lines_are_set_aside(full: Path, line: bytes) -> None:
    with (full / "journal.jsonl").open("ab") as file:
        file.write(line)
    journal = opened(full)
    assert list(journal.done) == KEYS[:3]
    assert journal.set_aside.read_bytes() == line
    journal.close()


def test_the_first_of_two_lines_counts(full: Path) -> None:
    path = full / "journal.jsonl"
    first = path.read_bytes().splitlines(keepends=True)[0]
    path.write_bytes(path.read_bytes() + first)
    journal = opened(full)
    assert journal.done[KEYS[0]] == 0
    assert journal.set_aside.read_bytes() == first
    journal.close()


def test_what_is_set_aside_is_never_overwritten(full: Path) -> None:
    for text in (b"one\n", b"two\n"):
        with (full / "journal.jsonl").open("ab") as file:
            file.write(text)
        opened(full).close()
    assert [p.read_bytes() for p in sorted((full / "aside").iterdir())] == [b"one\n", b"two\n"]


def test_two_runs_do_not_write_into_one_folder(full: Path) -> None:
    journal = opened(full)
    with pytest.raises(InputError, match="another tsbench run is writing here"):
        opened(full)
    journal.close()


def test_lines_carry_their_checksum() -> None:
    line = encode({"a": 1})
    assert decode(line) == {"a": 1}
    assert decode(line.replace(b"1}", b"2}")) is None
    assert decode(line[:-1]) is None


def test_errors_read_equal_when_they_are() -> None:
    assert one_line("no\n  <object at 0x7fb7e8d13870>") == "no <object at 0x…>"
    assert len(one_line("x" * 10_000)) <= 300
