"""Results of rows that a new edition leaves as they are."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import ModuleType

import pytest
from scripts import load_script

from tsbench.core.errors import InputError
from tsbench.run.log.journal import lines_so_far, read_table

KEPT = Path(__file__).resolve().parents[2] / "results/dev"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return Path(shutil.copytree(KEPT, tmp_path / "dev"))


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Where one row was another when the run was driven; a shallow clone lacks the run's commit."""
    script = load_script("carry_rows")
    found = script.digests("moscow", "dev")
    changed = list(found)[1]
    monkeypatch.setattr(script, "_digests_at", lambda *_: found | {changed: "another", "gone": "row"})
    monkeypatch.setattr(script, "CHANGED", changed, raising=False)
    # The run may be another machine's.
    monkeypatch.setattr(script, "differences", lambda was, *_: () if was else ("none",))
    return script


def test_all_but_changed_rows_are_taken_over_as_they_stand(script: ModuleType, run: Path) -> None:
    episodes = read_table(run / "episodes.parquet").to_pylist()
    planners = len({row["planner"] for row in episodes})
    assert script.carry(run) == (len(episodes) - planners, len(episodes))
    carried = [line["row"] for line in lines_so_far(run / "journal.jsonl")]
    wanted = [row for row in episodes if row["scenario_id"] != script.CHANGED]
    order = ("planner", "scenario_id")
    assert sorted(carried, key=lambda row: [row[k] for k in order]) == wanted
    manifest = json.loads((run / "run.json").read_text())
    commit = json.loads((KEPT / "run.json").read_text())["git"]["commit"]
    assert manifest["status"] == "interrupted"
    assert (manifest["sessions"][-1]["carried_from"], manifest["sessions"][-1]["episodes"]) == (commit, len(wanted))


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"status": "interrupted"}, "is not complete"),
        ({"edition": "2026.4+local"}, "does not have"),
        ({"contract": "a" * 64}, "does not have"),
        ({"arithmetic": None}, "of two machines"),
    ],
)
def test_a_run_that_no_commit_explains_is_refused(
    script: ModuleType, run: Path, part: dict[str, object], said: str
) -> None:
    manifest = json.loads((run / "run.json").read_text()) | part
    (run / "run.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=said):
        script.carry(run)
    assert (run / "episodes.parquet").is_file()
