"""The formats that episodes are exported in."""

from __future__ import annotations

import importlib

from tsbench.errors import InputError
from tsbench.report.episode_files import FileKind

# By format: where its writer is, its files' suffix, and the extra that it needs ("" for none).
WRITERS = {
    "commonroad": ("tsbench.report.export.commonroad:write_commonroad", ".xml", ""),
    "mcap": ("tsbench.report.export.recording:write_recording", ".mcap", "mcap"),
}
FORMATS = tuple(WRITERS)


def export_kind(name: str) -> FileKind:
    """Files of a format; InputError where the extra that its writer needs is not installed."""
    target, suffix, extra = WRITERS[name]
    module, _, function = target.partition(":")
    try:
        return FileKind("exports", suffix, getattr(importlib.import_module(module), function))
    except ModuleNotFoundError as missing:
        if not extra:
            raise
        raise InputError(
            f"--format {name}: {missing.name} is not installed (pip install 'tsbench[{extra}]')"
        ) from None
