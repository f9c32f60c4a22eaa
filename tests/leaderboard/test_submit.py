"""What may be submitted, and that a submission says what the run says."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.episode.trace import SCHEMA as TRACE
from tsbench.leaderboard.submission import Submission, episode_of, json_schema, read_submission
from tsbench.leaderboard.submit import make_submission
from tsbench.run.edition import LOCAL
from tsbench.run.log import read

Make = Callable[..., Submission]


def test_it_says_what_the_run_says(run: Path, make: Make, tmp_path: Path) -> None:
    made = make("idm", title="IDM", url="https://x", third_party=True)
    path = tmp_path / "idm.json"
    path.write_text(made.to_json(), encoding="utf-8")
    assert read_submission(path) == made
    assert (made.title, made.planner.name, made.third_party, len(made.episodes)) == ("IDM", "idm", True, 108)
    summary = tsbench.load_run(run).summary()
    mine = summary[(summary.planner == "idm") & (summary.reading == "strict")]
    for figure in made.figures:
        row = mine[(mine.figure == figure.figure) & (mine.name == figure.over)].iloc[0]
        assert (row.value, row.n) == (pytest.approx(figure.value), figure.n)
        assert figure.low is None or (row.low, row.high) == (
            pytest.approx(figure.low),
            pytest.approx(figure.high),
        )
    assert 0 < made.rescored < 108, "what has a trace"


def test_a_digest_is_of_everything_that_was_driven_and_of_no_name() -> None:
    row = {
        "planner": "a",
        "scenario_id": "s",
        "outcome": "arrived",
        "scd": True,
        "error": None,
        "progress": 0.5,
    }
    event = {"planner": "a", "number": 0, "clause": "over_limit", "target": True, "value": float("nan")}
    told = episode_of(row, [event])
    assert told.clauses == ("over_limit",)
    assert episode_of({**row, "planner": "b"}, [{**event, "planner": "b"}]) == told
    assert episode_of({**row, "progress": 0.5 + 2**-52}, [event]).digest != told.digest
    assert episode_of(row, []).digest != told.digest
    # Another sign's event is no failure; needless obedience is one.
    assert episode_of(row, [{**event, "target": False}]).clauses == ()
    assert episode_of(row, [{**event, "target": False, "clause": "needless_stop"}]).clauses == (
        "needless_stop",
    )


def test_a_planner_is_named_where_there_are_several(make: Make) -> None:
    with pytest.raises(InputError, match=r"name one with --planner .idm, idm-e"):
        make(None)
    with pytest.raises(InputError, match="no planner carl; there are idm, idm-e"):
        make("carl")


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("variants", "0", "variants is 0: a submission is of a whole split"),
        ("half", "signed", "half is signed"),
        ("limit", 5, "limit is 5"),
        ("mask_signs", True, "mask_signs is True"),
    ],
)
def test_a_part_of_a_split_is_none(run: Path, make: Make, key: str, value: object, told: str) -> None:
    path = run / "run.json"
    manifest = json.loads(path.read_text())
    manifest["effective"][key] = value
    path.write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=told):
        make()


def test_what_was_changed_since_the_release_is_none(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read, "edition_of", lambda *_: f"2026.2{LOCAL}")
    with pytest.raises(InputError, match="code or data were changed since the release"):
        make_submission(run, "idm", title="", authors="us", url="", note="", third_party=False)


def test_an_edited_table_is_none(run: Path, make: Make) -> None:
    path = run / "episodes.parquet"
    table = pq.read_table(path)
    passed = table.column_names.index("scd")
    pq.write_table(table.set_column(passed, table.field("scd"), [[True] * len(table)]), path)
    with pytest.raises(InputError, match="is not the file that the run wrote"):
        make()
    # Nor where the manifest was edited, too: the traces say otherwise.
    manifest = json.loads((run / "run.json").read_text())
    manifest["files"]["episodes.parquet"] = sha256_of(path)
    (run / "run.json").write_text(json.dumps(manifest))
    with pytest.raises(
        InputError, match=r"disagreements with its own traces: .*scd is True, by its trace False"
    ):
        make()


def test_an_edited_trace_is_none(run: Path, make: Make) -> None:
    path = next((run / "traces" / "idm").glob("*.parquet"))
    file = pq.ParquetFile(path)
    metadata = file.metadata.metadata[b"tsbench.trace"]
    table = file.read()
    at = table.column_names.index("ego_speed")
    slower = [0.5 * value for value in table["ego_speed"].to_pylist()]
    with pq.ParquetWriter(path, TRACE, compression="zstd") as writer:
        writer.write_table(table.set_column(at, table.field("ego_speed"), [slower]).cast(TRACE))
        writer.add_key_value_metadata({b"tsbench.trace": metadata})
    with pytest.raises(InputError, match="disagreements with its own traces"):
        make()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda d: d.pop("kind"), "no submission"),
        (lambda d: d.update(schema=2), "schema 2, this tsbench reads 1"),
        (lambda d: d.update(more=1), "malformed submission"),
        (lambda d: d["episodes"][0].update(outcome="won"), "malformed submission .*won"),
        (lambda d: d["episodes"].append(d["episodes"][0]), "one stands twice"),
        (lambda d: d["episodes"][0].update(scd="yes"), "malformed submission"),
    ],
)
def test_a_malformed_one_is_one_line(make: Make, tmp_path: Path, change: Callable, told: str) -> None:
    data = json.loads(make().to_json())
    change(data)
    (tmp_path / "x.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=told) as caught:
        read_submission(tmp_path / "x.json")
    assert "\n" not in str(caught.value)


def test_a_missing_episode_is_told(make: Make) -> None:
    from tsbench.leaderboard.submission import figures_of
    from tsbench.scenarios.table import read_table, table_path

    made = make()
    spared = replace(made, episodes=made.episodes[1:])
    with pytest.raises(InputError, match=r"1 missing .*, 0 of no row"):
        figures_of(spared.episodes, read_table(table_path("dev")), made.planner, made.contract)


def test_the_schema_is_of_what_is_written(honest: Make) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    data = json.loads(honest("idm").to_json())
    jsonschema.validate(data, schema)
    for change in ({"rescored": "1"}, {"more": 1}, {"episodes": [{}]}, {"schema": 2}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**data, **change}, schema)
