"""Frames on disk, in chunks: a few drives each, as one NumPy file, made when they are first asked for.

A chunk's content depends on the plan and its number alone, so a dropped one is the same when made again: the
folder never grows beyond its bound, whatever the number of drives.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import ClassVar

import numpy as np

from tsbench.core.errors import InputError, SimulationError
from tsbench.core.files import replacing
from tsbench.core.machine import one_thread_each
from tsbench.core.seeds import rng_of
from tsbench.learn.imitation.frames import FRAME, DriveResult, Drivers, Imitated, Sampling, frames_of
from tsbench.learn.imitation.targets import EpisodeDrive, FinetuneSource
from tsbench.learn.plant2.plant2_planner import Plant2
from tsbench.learn.plant2.tokens import Records

DRIVES_PER_CHUNK = 20
_ATTEMPTS = 3


@dataclass(frozen=True)
class ImitationSource:
    """Frames of `plant2`, which sees no signs: every kept tick, whatever became of the drive.

    As every source of frames it holds all that decides them, and is sent to the processes that drive.
    """

    dtype: ClassVar[np.dtype[np.void]] = FRAME
    sampling: Sampling

    def frames(self, driven: DriveResult, drivers: Drivers, rng: np.random.Generator) -> Records:
        teacher = Imitated(driven, self.sampling)
        encoder = drivers.tokeniser(driven.roads, Plant2.side_m)
        return frames_of(driven, encoder, teacher, self.sampling, rng, FRAME)


Source = ImitationSource | FinetuneSource


def plan_hash(drives: Sequence[EpisodeDrive], source: Source, seed: int) -> str:
    """12 hex digits over all that decides the content of the chunks."""
    plan = {"drives": [drive.facts() for drive in drives], "source": asdict(source), "seed": seed}
    return hashlib.sha256(json.dumps(plan, sort_keys=True).encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class TrainingResources:
    """Where and with what a training runs.

    workers: processes that drive, threads that learn. cache_bytes: bound of the frames on disk.
    """

    out: Path
    device: str
    workers: int
    cache_bytes: int


class FrameStore:
    """The chunks of a list of drives, in a folder of their own; at most `cache_bytes` of them at a time.

    progress: called with the number of drives after each chunk that was made.
    """

    def __init__(
        self,
        resources: TrainingResources,
        drives: Sequence[EpisodeDrive],
        source: Source,
        seed: int,
        progress: Callable[[int], None],
    ) -> None:
        self.plan = plan_hash(drives, source, seed)
        self._resources, self._source, self._seed, self._progress = resources, source, seed, progress
        self._folder = resources.out / "frames" / self.plan
        self._chunks = [list(drives[k : k + DRIVES_PER_CHUNK]) for k in range(0, len(drives), DRIVES_PER_CHUNK)]
        self._folder.mkdir(parents=True, exist_ok=True)

    def __len__(self) -> int:
        return len(self._chunks)

    def load(self, numbers: Sequence[int]) -> Records:
        """All frames of some chunks, those that are missing made first."""
        self._make(numbers)
        frames = np.concatenate([self._read(n) for n in numbers])
        self._drop(keep=set(numbers))
        return frames

    def _path(self, number: int) -> Path:
        return self._folder / f"chunk-{number:05d}.npy"

    def _read(self, number: int) -> Records:
        try:
            frames: Records = np.load(self._path(number), allow_pickle=False)
        except (OSError, ValueError) as error:
            raise InputError(f"{self._path(number)}: no frames ({error}): delete it") from None
        if frames.dtype != self._source.dtype:
            raise InputError(f"{self._path(number)}: frames of another tsbench: delete {self._folder}")
        return frames

    def _make(self, numbers: Sequence[int]) -> None:
        for _ in range(_ATTEMPTS):
            missing = self._missing(numbers)
            if not missing:
                return
            # libsumo has one simulation per process, and a process that dies takes its pool along, not the training.
            with (
                suppress(BrokenProcessPool),
                one_thread_each(),
                ProcessPoolExecutor(self._resources.workers, mp_context=get_context("spawn")) as pool,
            ):
                jobs = {
                    pool.submit(make_chunk, self._path(n), self._chunks[n], self._source, (self._seed, n)): n
                    for n in missing
                }
                for job in as_completed(jobs):
                    job.result()
                    self._progress(len(self._chunks[jobs[job]]))
        if missing := self._missing(numbers):
            path = self._path(missing[0])
            raise SimulationError(f"{path}: the process that drives for it died {_ATTEMPTS} times")

    def _missing(self, numbers: Sequence[int]) -> list[int]:
        return [n for n in numbers if not self._path(n).is_file()]

    def _drop(self, keep: set[int]) -> None:
        """Delete chunks until the rest keeps to the bound; those in use last."""
        paths = {n: self._path(n) for n in range(len(self)) if self._path(n).is_file()}
        total = sum(path.stat().st_size for path in paths.values())
        for number in sorted(paths, key=lambda n: (n in keep, n)):
            if total <= self._resources.cache_bytes or number in keep:
                return
            total -= paths[number].stat().st_size
            paths[number].unlink()


def make_chunk(path: Path, drives: Sequence[EpisodeDrive], source: Source, seed: tuple[int, int]) -> None:
    """Drive and write the frames, all or nothing. Drives that end in an error of the simulation give none."""
    drivers = Drivers()
    found: list[Records] = [np.zeros(0, dtype=source.dtype)]
    for drive in drives:
        driven = drive.run(drivers)
        if driven is not None:
            found.append(source.frames(driven, drivers, rng_of("frames", *seed, *drive.names)))
    drivers.close()
    with replacing(path) as part, part.open("wb") as file:
        np.save(file, np.concatenate(found), allow_pickle=False)
