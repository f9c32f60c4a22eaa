"""Where tables are printed."""

from __future__ import annotations

import os
import sys

from rich.console import Console

_LOG_WIDTH = 160


def table_console() -> Console:
    """Standard output; without a terminal there is no width to keep to: a log shall have the whole table."""
    fixed = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(width=None if fixed else _LOG_WIDTH)
