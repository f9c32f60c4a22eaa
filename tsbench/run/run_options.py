"""The options of a run, for the command line, Python, tsbench.toml, `run.json` and the workers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.episode.perception_level import EXACT, Perception, load_level
from tsbench.planners.batching import DEVICES
from tsbench.run.execution.executor import Limits
from tsbench.run.execution.local import EXECUTORS
from tsbench.run.execution.messages import RUNNER
from tsbench.run.log.manifest import plain_perception
from tsbench.run.plan import BOTH, TRACES, Request, RunPlan
from tsbench.scenarios.table import SPLITS

LEAST_MEMORY_MB = 512


@dataclass(frozen=True)
class Options:
    """Everything that `tsbench run` takes. workers: processes, None = one for each core. out: None = a name below
    `runs/`. executor: one of `local.EXECUTORS`.

    city: whose data set is in use. perception: a level's name or file.
    isolate: planners in processes of their own; image: in containers of this image.

    overwrite: a run that is in the folder is removed first. allow_partial: aggregate over holes too. limits: how long a
    worker may be silent and how large it may become.
    runner is for tests: what runs an episode in a worker.
    """

    request: Request
    city: str = OWN_CITY
    workers: int | None = None
    executor: str = "local"
    out: Path | None = None
    trace: str = "violations"
    device: str = "cpu"
    mask_signs: bool = False
    perception: str = EXACT
    isolate: bool = False
    image: str | None = None
    overwrite: bool = False
    allow_partial: bool = False
    limits: Limits = field(default_factory=Limits)
    runner: str = RUNNER

    def check(self) -> None:
        """Refuse what the command line refuses by itself, for callers from Python. Raises InputError."""
        names, known = ("split", "trace", "device", "executor"), (SPLITS, TRACES, DEVICES, EXECUTORS)
        values = (self.request.split, self.trace, self.device, self.executor)
        for name, value, choices in zip(names, values, known, strict=True):
            if value not in choices:
                raise InputError(f"--{name} {value}: expected {', '.join(choices)}")
        least = {"workers": (self.workers, 1), "memory-limit": (self.limits.most_memory, LEAST_MEMORY_MB)}
        for name, (number, bound) in least.items():
            if number is not None and number < bound:
                raise InputError(f"--{name} {number:g}: expected at least {bound}")
        if self.isolate and (self.executor != "local" or self.device != "cpu"):
            raise InputError(
                "--isolate: planners are isolated on this machine and its CPU: leave out --executor and --device"
            )

    def perceived(self) -> Perception:
        """How plates reach the planners. Raises InputError for no level."""
        return Perception(self.mask_signs, load_level(self.perception))

    def folder_name(self, names: Sequence[str], contract: str) -> str:
        """Folder name of a run without `--out`; runs that differ in their selection do not meet in one folder."""
        request = self.request
        shown = [*names[:3], *([f"and-{len(names) - 3}-more"] if len(names) > 3 else [])]
        parts = ["+".join(quote(name, safe="") for name in shown), request.split]
        parts += ["+".join(request.types)] if request.types else []
        parts += [f"variants-{request.variants}"] if request.variants != "all" else []
        parts += [f"{request.half}-half"] if request.half != BOTH else []
        parts += [f"limit-{request.limit}"] if request.limit is not None else []
        parts += ["masked"] if self.mask_signs else []
        parts += [] if self.perception == EXACT else [f"eyes-{quote(Path(self.perception).stem, safe='')}"]
        return "-".join([*parts, contract[:8]])

    def plain(self) -> dict[str, Any]:
        """What was asked, as it stands in a manifest."""
        return {
            **asdict(self.request),
            "workers": self.workers,
            "executor": self.executor,
            "out": None if self.out is None else str(self.out),
            "trace": self.trace,
            "device": self.device,
            "mask_signs": self.mask_signs,
            **({} if self.perception == EXACT else {"perception": self.perception}),
            "isolate": self.isolate,
            "memory_limit": self.limits.most_memory,
        }

    def resolved(self, plan: RunPlan, perception: Perception) -> dict[str, Any]:
        """What the options came to, as far as it decides what stands in the folder."""
        return {
            **({} if self.city == OWN_CITY else {"city": self.city}),
            "split": plan.request.split,
            "types": list(plan.types),
            "variants": plan.request.variants,
            "half": plan.request.half,
            "limit": plan.request.limit,
            "scenarios": len(plan.scenarios),
            "trace": self.trace,
            "device": self.device,
            **plain_perception(perception),
            **({"isolate": True} if self.isolate else {}),
            "memory_limit": self.limits.most_memory,
        }
