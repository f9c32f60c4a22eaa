"""Run folders made by hand: real manifests and tables, episodes that were never driven."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.episode.perception_level import load_level
from tsbench.run.log.journal import file_hashes
from tsbench.run.log.manifest import new_manifest
from tsbench.run.log.record import EPISODES, LATER, SCHEMA_VERSION, TABLES
from tsbench.run.planner_info import PlannerInfo

CONTRACT = "c0ffee" * 10 + "beef"
TYPES = (("yield", "priority"), ("speed_limit", "speed"))


def episode(planner: str, kind: int, number: int, variant: int, **other: Any) -> dict[str, Any]:
    """A row that arrived and complied, unless told otherwise."""
    name, group = TYPES[kind]
    given: dict[str, Any] = {
        "planner": planner, "scenario_id": f"{name}-m{number}-v{variant}", "scenario_type": name, "group": group,
        "sign_code": "2.4", "map_id": f"map-{kind}-{number}", "family": "junction", "shape": "cross", "slot": "",
        "variant": variant, "split": "test", "seed": variant, "privileged": False, "outcome": "arrived",
        "sign_compliant": True, "sign_engaged": True, "destination": True, "scd": True, "route_completion": 100.0,
        "driving_score": 100.0, "collision": False, "off_road": False, "comfort": 0.9, "mean_speed": 7.0,
    }  # fmt: skip
    return dict.fromkeys(EPISODES.names) | LATER | given | other


def lost(clause: str = "did_not_yield") -> dict[str, Any]:
    return {"scd": False, "sign_compliant": False, "driving_score": 90.0, "violation_clause": clause}


def failed(error: str) -> dict[str, Any]:
    names = ("sign_compliant", "sign_engaged", "destination", "route_completion", "driving_score", "collision",
             "off_road", "comfort", "mean_speed")  # fmt: skip
    return dict.fromkeys(names) | {"scd": False, "outcome": "planner_error", "error": error}


def episodes(planner: str, maps: int = 6, variants: int = 4, **changes: dict[str, Any]) -> list[dict[str, Any]]:
    """maps x variants of each type; changes: by scenario id with underscores for dashes."""
    rows = [episode(planner, k, m, v) for k in range(len(TYPES)) for m in range(maps) for v in range(variants)]
    return [row | changes.get(row["scenario_id"].replace("-", "_"), {}) for row in rows]


def pairs(planner: str, **changes: dict[str, Any]) -> list[dict[str, Any]]:
    """As `episodes`, each with a contrast half: speed limits post another value, yield's plate is a main road's."""
    signed = [row | {"pair_id": row["scenario_id"], "place": row["map_id"]} for row in episodes(planner)]
    other = {"half": "contrast"}
    contrast = [row | other | {"scenario_id": f"{row['scenario_id']}-c"} for row in signed]
    contrast = [row | {"scenario_type": "main_road"} if row["group"] == "priority" else row for row in contrast]
    rows = signed + contrast
    return [row | changes.get(row["scenario_id"].replace("-", "_"), {}) for row in rows]


def level(name: str) -> dict[str, Any]:
    """A level of perception as a manifest has it."""
    found = load_level(name)
    assert found is not None
    return asdict(found)


def make_run(
    path: Path,
    rows: list[dict[str, Any]],
    asked: int | None = None,
    contract: str = CONTRACT,
    events: list[dict[str, Any]] | None = None,
    floors: tuple[str, ...] = (),
    **effective: Any,
) -> Path:
    """Write a run folder.

    asked: scenarios of each planner, by default those with a record; events: violations; floors: planners that are.
    """
    path.mkdir(parents=True)
    names = list(dict.fromkeys(row["planner"] for row in rows))
    n = len(rows) // len(names) if asked is None else asked
    manifest = json.loads(_manifest())
    manifest["contract"] = contract
    manifest["planners"] = [
        asdict(PlannerInfo(name, name, False, True, (), None, None, name in floors)) for name in names
    ]
    manifest["effective"] |= {"scenarios": n} | effective
    rows = sorted(rows, key=lambda row: (row["planner"], row["scenario_id"]))
    for name, schema in TABLES.items():
        metadata = {"tsbench_schema": str(SCHEMA_VERSION), "tsbench_contract": contract}
        content = {"episodes.parquet": rows, "violations.parquet": events or []}.get(name, [])
        pq.write_table(pa.Table.from_pylist(content, schema=schema.with_metadata(metadata)), path / name)
    manifest |= {"status": "complete" if n * len(names) == len(rows) else "interrupted", "files": file_hashes(path)}
    (path / "run.json").write_text(json.dumps(manifest))
    return path


@cache
def _manifest() -> str:
    effective = {"split": "test", "types": [name for name, _ in TYPES], "variants": "all", "limit": None,
                 "trace": "none", "device": "cpu", "mask_signs": False}  # fmt: skip
    return json.dumps(new_manifest(CONTRACT, {}, effective, []))
