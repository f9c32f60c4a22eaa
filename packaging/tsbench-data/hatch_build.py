"""Puts the files of the set `test` into the wheel, each checked against the manifest of tsbench, and kept results."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

CLONE = Path(__file__).resolve().parents[2]


class DataFiles(BuildHookInterface[Any]):
    """Which files of the clone go where in the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Adds each file of the set; refuses one that is not what the manifest says."""
        manifest = json.loads((CLONE / "tsbench/core/data_manifest.json").read_text(encoding="utf-8"))
        for name, size, sha256 in manifest["sets"]["test"]["files"]:
            content = (CLONE / name).read_bytes()
            if len(content) != size or hashlib.sha256(content).hexdigest() != sha256:
                raise SystemExit(f"{name}: is not the file that the manifest names: make manifest")
            build_data["force_include"][str(CLONE / name)] = f"tsbench_data/{name}"
        for run in (CLONE / "results").glob("*/run.json"):
            for path in (run, *run.parent.glob("*.parquet")):
                build_data["force_include"][str(path)] = f"tsbench_data/{path.relative_to(CLONE)}"


class OneVersion(MetadataHookInterface):
    """Data and code have one version."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Asks for tsbench of the data's own version."""
        metadata["dependencies"] = [f"tsbench=={metadata['version']}"]
