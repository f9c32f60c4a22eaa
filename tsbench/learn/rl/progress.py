"""Watches over a training: counts how episodes end, tells, logs for TensorBoard, and keeps checkpoints."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from tsbench.learn.rl.checkpoint import Progress, save_checkpoint

CURVE = "curve.jsonl"
_WINDOW = 200
_ENDS = ("arrived", "collision", "off_road", "timeout")


class ProgressCallback(BaseCallback):
    """At the end of each rollout: one line, one row of the curve, a checkpoint each `every` seconds.

    before: what earlier sittings have done. tell: prints a line.
    """

    def __init__(
        self,
        out: Path,
        job: dict[str, Any],
        before: Progress,
        total: int,
        tell: Callable[[str], None],
        every: float,
    ) -> None:
        super().__init__()
        self._out, self._job, self._before, self._total, self._tell = out, job, before, total, tell
        self._every, self._saved = every, time.monotonic()
        self._began, self._told = time.monotonic(), 0.0
        self._ends: deque[str] = deque(maxlen=_WINDOW)
        self._earned: deque[float] = deque(maxlen=_WINDOW)
        self._completion: deque[float] = deque(maxlen=_WINDOW)
        self._broken = 0

    @property
    def progress(self) -> Progress:
        """What has been done by now, this sitting included."""
        seconds = self._before.seconds + time.monotonic() - self._began
        return replace(
            self._before,
            steps=self.model.num_timesteps,
            seconds=seconds,
            sittings=self._before.sittings + 1,
        )

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "outcome" not in info:
                continue
            if info["error"]:
                self._broken += 1
                self._tell(f"an episode broke off: {info['error']}")
                continue
            self._ends.append(info["outcome"])
            self._earned.append(float(info["episode"]["r"]))
            self._completion.append(float(info["route_completion"]))
        return True

    def _on_rollout_end(self) -> None:
        shares = {name: self._ends.count(name) / max(len(self._ends), 1) for name in _ENDS}
        row: dict[str, float] = {
            "steps": self.num_timesteps,
            "seconds": round(self.progress.seconds, 1),
            "reward": round(float(np.mean(self._earned)), 4) if self._earned else 0.0,
            "route_completion": round(float(np.mean(self._completion)), 2) if self._completion else 0.0,
            **{name: round(share, 4) for name, share in shares.items()},
            "broken": self._broken,
        }
        for name, value in row.items():
            if name not in ("steps", "seconds"):
                self.logger.record(f"episodes/{name}", value)
        with (self._out / CURVE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        now = time.monotonic()
        if now - self._told > 10.0:
            self._told = now
            rate = (self.num_timesteps - self._before.steps) / (now - self._began)
            left = (self._total - self.num_timesteps) / rate / 60.0
            self._tell(
                f"{self.num_timesteps:>9,} of {self._total:,} steps  {rate:5.0f} steps/s  {left:5.0f} min to go  "
                f"reward {row['reward']:+.2f}  arrived {row['arrived']:.2f}  collision {row['collision']:.2f}  "
                f"off road {row['off_road']:.2f}  timeout {row['timeout']:.2f}"
            )
        if now - self._saved > self._every:
            self.keep()

    def keep(self) -> None:
        """A checkpoint now."""
        save_checkpoint(self._out, self.model, self.progress, self._job)  # type: ignore[arg-type]
        self._saved = time.monotonic()
