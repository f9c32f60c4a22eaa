"""A metric: one declaration; column, figures and its row of docs/metrics.md follow; older runs stay readable."""

from __future__ import annotations

import shutil

import pyarrow.parquet as pq
from own_copy import ROOT, Copy, records

DECLARATION = """    Metric(
        "top_speed", float, lambda e: float(e.tracks.speed.max()), "m/s, greatest", "top_speed", "m/s", head="top",
    ),
"""


def test_a_metric_is_one_declaration(clone: Copy) -> None:
    clone.scene("speed_limit")
    shutil.copytree(ROOT / "docs", clone.root / "docs", ignore=shutil.ignore_patterns("*.png"))
    clone.tsbench("run --planner idm --split test --out before")
    clone.add_line("tsbench/metrics/episode_metrics.py", '    Metric("duration_s"', DECLARATION)
    told = clone.tsbench(
        "run --planner idm --planner idm-e --split test --out after",
        "analyse main after --out tables",
        "analyse pages docs/metrics.md --from tables",
        "analyse main before --out older",
        "report before --out before.html",
    )
    found = records(clone.root / "after")
    assert found["idm"]["top_speed"] > found["idm-e"]["top_speed"] > found["idm-e"]["mean_speed"]
    assert '"top_speed": "m/s"' in (clone.root / "after" / "summary.json").read_text()
    assert "top" in told
    assert "top" in (clone.root / "tables" / "main.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "| `top_speed` | m/s, greatest |" in (clone.root / "docs" / "metrics.md").read_text(encoding="utf-8")
    # A run from before has no value of it, and keeps all others.
    assert "top_speed" not in pq.read_schema(clone.root / "before" / "episodes.parquet").names
    assert "idm" in (clone.root / "older" / "main.csv").read_text(encoding="utf-8")
    assert (clone.root / "before.html").stat().st_size > 10_000
