"""Records and tables: every column is there, typed, and null where nothing was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest
from run_helpers import episode_builders, specs

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.run.log.journal import Journal, Quarantine, read_table, write_tables
from tsbench.run.log.record import EPISODES, TABLES, last_seconds, make_record


def result(spec=None, **other):
    egos = [episode_builders.ego(10.0 + k, speed=10.0) for k in range(30)]
    mine, context = episode_builders.violation(1.0), episode_builders.violation(0.5, sign_id="other")
    facts = episode_builders.facts(
        egos,
        outcome=other.get("outcome", Outcome.ARRIVED),
        target=episode_builders.verdict(episode_builders.violation(2.0), mine),
        others=(episode_builders.verdict(context),),
    )
    return episode_builders.result(facts, "idm", spec=spec or specs()[0], **other)


def test_a_finished_episode() -> None:
    record = make_record(result(), True)
    assert set(record.row) == set(EPISODES.names)
    assert record.row["outcome"] == "arrived"
    assert record.row["error"] is None
    assert record.row["privileged"] is True
    assert record.row["scd"] is False
    assert record.row["violations"] == 2
    assert [(e["number"], e["target"], e["start_s"]) for e in record.events] == [
        (0, True, 1.0), (1, True, 2.0), (2, False, 0.5),
    ]  # fmt: skip
    assert record.detail == ""
    assert record.timing["ticks"] == 29


def test_needless_obedience_is_an_event_of_the_target_sign() -> None:
    needless = (episode_builders.violation(0.2, rule="needless", clause="needless_stop"),)
    plain = result()
    verdicts = replace(plain.facts.verdicts, needless=needless)
    record = make_record(replace(plain, facts=replace(plain.facts, verdicts=verdicts)), True)
    assert (record.row["scd"], record.row["violations"], record.row["needless"]) == (False, 2, 1)
    assert record.row["violation_clause"] == "needless_stop"
    first = record.events[0]
    assert (first["number"], first["target"], first["rule"]) == (0, True, "needless")


def test_an_error_has_no_figures() -> None:
    record = make_record(result(outcome=Outcome.PLANNER_ERROR, error="Oops: no", detail="Trace"), False)
    assert set(record.row) == set(EPISODES.names)
    assert record.row["error"] == "Oops: no"
    assert record.row["scd"] is False
    assert {record.row[m.column] for m in EPISODE_METRICS if m.column != "scd"} == {None}
    assert record.events == []
    assert record.detail == "Trace"


def test_an_episode_without_facts_is_an_error() -> None:
    assert make_record(episode_builders.result(None, spec=specs()[0]), False).row["outcome"] == "sim_error"


def test_last_seconds_end_with_the_last_tick() -> None:
    assert last_seconds(result()).splitlines()[-1].split()[0] == "2.9"
    assert last_seconds(episode_builders.result(None)) == ""


def opened(folder: Path, keys: list[tuple[str, str]]) -> Journal:
    return Journal(folder / "journal.jsonl", keys, "this run", Quarantine(folder), lambda content: True)


def test_tables_do_not_depend_on_the_order_of_episodes(tmp_path: Path) -> None:
    rows = specs()
    keys = [("idm", row.scenario_id) for row in rows]
    content = []
    for number, order in enumerate((rows, rows[::-1])):
        folder = tmp_path / str(number)
        folder.mkdir()
        journal = opened(folder, keys)
        for row in order:
            journal.append(make_record(result(row), False))
        write_tables(folder, journal, "c0ffee")
        journal.close()
        content.append([(folder / name).read_bytes() for name in TABLES])
    assert content[0] == content[1]
    table = read_table(tmp_path / "0" / "episodes.parquet")
    assert table.schema.equals(EPISODES)
    assert table["scenario_id"].to_pylist() == sorted(row.scenario_id for row in rows)
    assert len(read_table(tmp_path / "0" / "violations.parquet")) == 3 * len(rows)


def test_a_null_where_none_may_be_is_a_defect(tmp_path: Path) -> None:
    record = make_record(result(), False)
    record.row["shape"] = None
    journal = opened(tmp_path, [("idm", specs()[0].scenario_id)])
    journal.append(record)
    with pytest.raises(ValueError, match="shape"):
        write_tables(tmp_path, journal, "c0ffee")
    journal.close()
    assert not (tmp_path / "episodes.parquet").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "no such table"), (b"PAR1 cut", "not a readable Parquet"), (pa.table({"a": [1]}), "schema version")],
)
def test_tables_that_are_none(tmp_path: Path, content, words: str) -> None:
    path = tmp_path / "episodes.parquet"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        pa.parquet.write_table(content, path)
    with pytest.raises(InputError, match=words):
        read_table(path)
