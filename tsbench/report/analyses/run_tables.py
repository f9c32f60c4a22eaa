"""The tables that a run ends with: the main one and that by type, of its own summary."""

from __future__ import annotations

from tsbench.metrics.aggregate import Summary
from tsbench.report.analyses.main_table import main_table
from tsbench.report.analyses.model import Analysis
from tsbench.report.analyses.per_type import per_type


def run_tables(summary: Summary) -> tuple[Analysis, ...]:
    """Both, under the summary's title."""
    return (
        main_table(summary.planners, summary.title, summary.contract_hash),
        per_type(summary.planners, f"{summary.title}: SCD by type", summary.contract_hash),
    )
