"""Analyses by name: a table waits for nothing that only pictures and significance tests need."""

from __future__ import annotations

import subprocess
import sys

ASKED = """
import sys
import numpy as np
import tsbench.run.log.tables
from tsbench.metrics.intervals import share_interval
from tsbench.report.analyses.by_name import OF_POOL
share_interval(np.ones((6, 1)), np.full((6, 1), 2.0))
print(sorted({"scipy.stats", "matplotlib"} & sys.modules.keys()), *OF_POOL)
"""


def test_tables_import_neither_matplotlib_nor_scipy_s_statistics() -> None:
    """Both take a second, at the end of every run and in each analysis."""
    told = subprocess.run([sys.executable, "-c", ASKED], capture_output=True, text=True, check=True).stdout
    assert told.split() == ["[]", "main", "types", "intervals", "failures", "correlations", "floor"]
