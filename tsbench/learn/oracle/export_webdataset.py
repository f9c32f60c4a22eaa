"""Ticks as WebDataset shards: tar files whose samples are drives. Arrays are .npy without pickles, facts are .json."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np

from tsbench.core.parquet import OSM_LICENCE
from tsbench.envs.scene import SceneSeen
from tsbench.learn.oracle.ticks import REWARDS, SEEN, Driven, shapes

# Drives in a shard: some 100 MB.
_SHARD = 100


class WebDatasetWriter:
    def __init__(self, folder: Path, seen: SceneSeen) -> None:
        self._folder, self._shapes = folder, shapes(seen)
        self._facts = {"rewards": list(REWARDS), "signs": list(seen.codes), **OSM_LICENCE}
        self._tar: tarfile.TarFile | None = None

    def add(self, drive: Driven) -> None:
        if drive.index % _SHARD == 0:
            self.close()
            self._tar = tarfile.TarFile(self._folder / f"drives-{drive.index // _SHARD:06d}.tar", "w")
        ticks, key = drive.ticks, f"{drive.index:08d}"
        self._put(f"{key}.json", json.dumps({**drive.facts, **self._facts}, sort_keys=True).encode())
        for name in SEEN:
            column = f"observation.{name}"
            self._array(f"{key}.{name}", [tick[column] for tick in ticks], self._shapes[column])
        self._array(f"{key}.action", [tick["action"] for tick in ticks], (2,))
        self._array(
            f"{key}.reward",
            [np.array([tick[f"reward.{name}"] for name in REWARDS], dtype=np.float32) for tick in ticks],
            (len(REWARDS),),
        )
        self._array(f"{key}.timestamp", [np.float64(tick["timestamp"]) for tick in ticks], ())
        self._array(f"{key}.done", [np.bool_(tick["done"]) for tick in ticks], ())

    def end(self) -> None:
        """Nothing is missing: each shard is whole when it is closed."""

    def close(self) -> None:
        if self._tar is not None:
            self._tar.close()

    def _array(self, name: str, rows: list[Any], shape: tuple[int, ...]) -> None:
        content = io.BytesIO()
        np.save(content, np.stack(rows).reshape(len(rows), *shape), allow_pickle=False)
        self._put(f"{name}.npy", content.getvalue())

    def _put(self, name: str, content: bytes) -> None:
        # Without times and owners: the same drives are the same bytes.
        facts = tarfile.TarInfo(name)
        facts.size = len(content)
        assert self._tar is not None
        self._tar.addfile(facts, io.BytesIO(content))
