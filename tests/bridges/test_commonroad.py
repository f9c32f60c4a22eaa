"""CommonRoad's planner: five scenes in its own environment (.venv/commonroad), and what it is told of them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

# Where `make setup` puts CommonRoad's packages, whose protobuf is nobody else's.
COMMONROAD = Path(sys.prefix) / "commonroad"
HANG_S = 600.0


@pytest.fixture(scope="module")
def seen() -> dict[str, Any]:
    """What `drive_commonroad.py` saw."""
    if not (COMMONROAD / "commonroad_rp").is_dir():
        pytest.skip(
            f"CommonRoad's planner is not in {COMMONROAD}: make setup puts it there, where a package index has it"
        )
    if sys.version_info >= (3, 12):
        pytest.skip("CommonRoad's reactive planner is for Python 3.11 and older")
    script = Path(__file__).parent / "commonroad" / "drive_commonroad.py"
    environment = {**os.environ, "PYTHONPATH": str(COMMONROAD), "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, env=environment, timeout=HANG_S, check=False
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_it_drives_five_scenes(seen: dict[str, Any]) -> None:
    assert [one["outcome"] for one in seen["driven"]] == ["arrived"] * 5, seen["driven"]
    assert all(1.5 < one["horizon"] < 4.05 for one in seen["driven"])
    assert seen["same"]


def test_it_minds_the_limit_that_commonroad_reads(seen: dict[str, Any]) -> None:
    limit, freed, *_ = seen["driven"]
    # The one that faces the ego; the other direction's shows its back.
    posted = [value for code, value, *_ in seen["told"][0]["plates"] if code == "3.24"]
    assert posted == [20.0]
    assert freed["fastest"] > limit["fastest"]


def test_lanelets_are_the_roads_lanes(seen: dict[str, Any]) -> None:
    for told in seen["told"]:
        assert told["lanelets"] >= told["lanes"] >= 2
        assert told["dangling"] == told["unfollowed"] == 0
        assert told["same_network"]
    assert max(told["lanes"] for told in seen["told"]) > 20


def test_a_limit_holds_from_its_plate_on(seen: dict[str, Any]) -> None:
    limits = [(k, *plate) for k, told in enumerate(seen["told"]) for plate in told["plates"] if plate[0] == "3.24"]
    assert limits
    for _, _, value, before, behind in limits:
        assert before is None
        assert behind == pytest.approx(value / 3.6, abs=1e-3)


def test_a_limit_is_over_at_its_end_plate(seen: dict[str, Any]) -> None:
    """In the first drive, the end that faces the other direction: its limit began before the map does."""
    ((_, _, before, behind),) = [plate for plate in seen["ended"] if plate[0] == "3.25"]
    assert before is None
    assert behind is None


def test_road_users_and_obstacles_are_all_there(seen: dict[str, Any]) -> None:
    for told in seen["told"]:
        here, there = told["road_users"]
        assert here == there
        assert told["forecast_steps"] in ([], [30])
        here, there = told["obstacles"]
        assert here == there
    assert any(told["road_users"][0] for told in seen["told"])
    assert any(told["obstacles"][0] for told in seen["told"])


def test_the_roads_edge_is_where_it_is(seen: dict[str, Any]) -> None:
    assert seen["edges"] == {"in a lane": False, "in a junction": False, "beside the road": True}


def test_forecasts_keep_to_the_lane(seen: dict[str, Any]) -> None:
    assert seen["ways"] == {"follows": True, "across": True, "alone": True}


def test_masked_plates_are_not_told(seen: dict[str, Any]) -> None:
    assert seen["masked"] == 0


def test_without_its_packages_one_line_says_so() -> None:
    without = "import sys; sys.modules['commonroad_rp'] = sys.modules['commonroad_dc'] = None"
    code = f"{without}; import tsbench.bridges.commonroad"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "the extra `commonroad` in an environment of its own" in done.stderr.splitlines()[-1]
