"""The formats that episodes are exported in."""

from __future__ import annotations

from tsbench.core.extras import load
from tsbench.report.episode_files import FileKind

# By format: where its writer is, and its files' suffix.
WRITERS = {
    "commonroad": ("tsbench.report.export.commonroad:write_commonroad", ".xml"),
    "mcap": ("tsbench.report.export.recording:write_recording", ".mcap"),
}
FORMATS = tuple(WRITERS)


def export_kind(name: str) -> FileKind:
    """Files of a format; InputError where the extra that its writer needs is not installed."""
    target, suffix = WRITERS[name]
    module, _, function = target.partition(":")
    return FileKind("exports", suffix, getattr(load(module), function))
