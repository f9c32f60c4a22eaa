"""What may be submitted, and that a submission says what the run says."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from forgeries import change_manifest, pass_all, slow_down
from submitted import TOWN

import tsbench
from tsbench.board.claim import claim_of, make_submission
from tsbench.board.submission import Submission, episode_of, figures_of, json_schema, read_submission
from tsbench.core.errors import InputError
from tsbench.core.parquet import OSM_LICENCE
from tsbench.episode.perception_level import Perception, load_level
from tsbench.run.edition import LOCAL
from tsbench.run.log import read
from tsbench.scenarios.data_set import DataSet

Make = Callable[..., Submission]
DEV_ROWS = len(DataSet(TOWN).table("dev"))


def test_it_says_what_the_run_says(run: Path, make: Make, tmp_path: Path) -> None:
    made = make("idm", title="IDM", url="https://x", third_party=True)
    path = tmp_path / "idm.json"
    path.write_text(made.to_json(), encoding="utf-8")
    assert read_submission(path) == made
    assert (made.title, made.planner.name, made.third_party, len(made.episodes)) == ("IDM", "idm", True, DEV_ROWS)
    summary = tsbench.load_run(run).summary()
    mine = summary[(summary.planner == "idm") & (summary.reading == "strict")]
    for figure in made.figures:
        row = mine[(mine.figure == figure.figure) & (mine.name == figure.over)].iloc[0]
        assert (row.value, row.n) == (pytest.approx(figure.value), figure.n)
        assert figure.low is None or (row.low, row.high) == (pytest.approx(figure.low), pytest.approx(figure.high))
    assert 0 < made.rescored < DEV_ROWS, "what has a trace"


def test_a_digest_is_of_everything_that_was_driven_and_of_no_name() -> None:
    row = {"planner": "a", "scenario_id": "s", "outcome": "arrived", "scd": True, "error": None, "progress": 0.5}
    event = {"planner": "a", "number": 0, "clause": "over_limit", "target": True, "value": float("nan")}
    told = episode_of(row, [event])
    assert told.clauses == ("over_limit",)
    assert episode_of({**row, "planner": "b"}, [{**event, "planner": "b"}]) == told
    assert episode_of({**row, "progress": 0.5 + 2**-52}, [event]).digest != told.digest
    assert episode_of(row, []).digest != told.digest
    # Another sign's event is no failure.
    assert episode_of(row, [{**event, "target": False}]).clauses == ()


def test_a_planner_is_named_where_there_are_several(make: Make) -> None:
    with pytest.raises(InputError, match=r"name one with --planner .idm, idm-e"):
        make(None)
    with pytest.raises(InputError, match="no planner carl; there are idm, idm-e"):
        make("carl")


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("variants", "0", "variants is 0: a submission is of a whole split"),
        ("variants", "one-per-type", "variants is one-per-type: a submission is of a whole split"),
        ("half", "signed", "half is signed"),
        ("limit", 5, "limit is 5"),
        ("perception", {"name": "poor", "right": 0.5}, "perception: ceiling: is missing"),
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


def test_a_perception_level_goes_along(run: Path, make: Make, tmp_path: Path) -> None:
    path = run / "run.json"
    manifest = json.loads(path.read_text())
    poor = load_level("poor")
    assert poor is not None
    for level, told in ((poor, None), (replace(poor, right=0.99), "called poor, but is not tsbench's")):
        manifest["effective"]["perception"] = json.loads(json.dumps(asdict(level)))
        path.write_text(json.dumps(manifest))
        if told is None:
            made = make()
            (tmp_path / "x.json").write_text(made.to_json())
            assert read_submission(tmp_path / "x.json").perception == poor
            assert claim_of(tmp_path / "x.json").perception == Perception(level=poor)
            assert made.level == "poor"
        else:
            with pytest.raises(InputError, match=told):
                make()


def test_the_licence_of_the_roads_goes_along(driven: Path, honest: Make) -> None:
    data = json.loads(honest("idm").to_json())
    assert {key: data[key] for key in OSM_LICENCE} == OSM_LICENCE
    for name in ("episodes", "violations", "timing"):
        metadata = pq.read_schema(driven / f"{name}.parquet").metadata
        assert {key: metadata[key.encode()].decode() for key in OSM_LICENCE} == OSM_LICENCE


def test_what_was_changed_since_the_release_is_none(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read, "edition_of", lambda *_: f"2026.2{LOCAL}")
    with pytest.raises(InputError, match="code or data were changed since the release"):
        make_submission(run, "idm", title="", authors="us", url="", note="", third_party=False)


def test_a_planner_that_shared_the_referees_process_is_none_unless_it_says_so(run: Path, make: Make) -> None:
    with pytest.raises(InputError, match="idm shared the referee's process: drive it with --isolate"):
        make(shared_process=False)
    assert make(shared_process=True).isolation is None
    change_manifest(run, isolation={"idm": {"namespaces": True}})
    assert make(shared_process=False).isolation == {"namespaces": True}
    with pytest.raises(InputError, match="idm-e shared the referee's process"):
        make("idm-e", shared_process=False)


def test_a_name_that_readers_take_for_another_is_none(run: Path, make: Make) -> None:
    text = (run / "run.json").read_text()
    (run / "run.json").write_text(text.replace('"name": "idm"', '"name": "id\\u200bm"'))
    with pytest.raises(InputError, match=r"nobody sees .*: rename it and drive it again"):
        make("id\u200bm")


def test_an_edited_table_is_none(run: Path, make: Make) -> None:
    before = (run / "run.json").read_bytes()
    pass_all(run)
    after = (run / "run.json").read_bytes()
    (run / "run.json").write_bytes(before)
    with pytest.raises(InputError, match="is not the file that the run wrote"):
        make()
    # Nor where the manifest was edited, too: the traces say otherwise.
    (run / "run.json").write_bytes(after)
    with pytest.raises(InputError, match=r"disagreements with its own traces: .*scd is True, by its trace False"):
        make()


def test_an_edited_trace_is_none(run: Path, make: Make) -> None:
    slow_down(next((run / "traces" / "idm").glob("*.parquet")))
    with pytest.raises(InputError, match="disagreements with its own traces"):
        make()


def test_a_missing_episode_is_told(honest: Make) -> None:
    made = honest("idm")
    spared = replace(made, episodes=made.episodes[1:])
    with pytest.raises(InputError, match=r"1 missing .*, 0 of no row"):
        figures_of(spared.episodes, DataSet(TOWN).table("dev"), made.planner, made.contract)


def test_the_schema_is_of_what_is_written(honest: Make) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    data = json.loads(honest("idm").to_json())
    jsonschema.validate(data, schema)
    for change in ({"rescored": "1"}, {"more": 1}, {"episodes": [{}]}, {"schema": 2}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**data, **change}, schema)


@pytest.mark.parametrize(
    ("field", "text", "said"),
    [
        ("title", "x" * 201, "title: expected one line of at most 200 characters"),
        ("authors", "us\nthem", "authors: expected one line of at most 1000 characters"),
        ("note", "x" * 10_001, "note: expected text of at most 10000 characters"),
        ("title", "\x1b[2J", "control characters in the text"),
    ],
)
def test_the_submitter_s_words_fit_a_page(make: Make, field: str, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make("idm", **{field: text})
