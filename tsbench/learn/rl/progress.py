"""Watches over a training: counts how episodes end, tells, logs for TensorBoard, and keeps checkpoints."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from tsbench.learn.checkpoint import load_checkpoint, save_checkpoint
from tsbench.learn.learning_curve import CURVE, add_row, draw_rl

_WINDOW = 200
_ENDS = ("arrived", "collision", "off_road", "timeout")


@dataclass(frozen=True, slots=True)
class RlProgress:
    """steps: decisions taken since imitation. seconds: of training so far, all sessions together. sessions: how many
    there were. imitated: rollouts of imitation. updates: as Stable-Baselines3 counts them.
    """

    steps: int = 0
    seconds: float = 0.0
    sessions: int = 0
    imitated: int = 0
    updates: int = 0


def save_progress(out: Path, model: PPO, progress: RlProgress, job: dict[str, Any]) -> None:
    now = asdict(replace(progress, updates=model._n_updates))
    save_checkpoint(out, model.policy, model.policy.optimizer, job, now)


def load_progress(out: Path, model: PPO, job: dict[str, Any]) -> RlProgress | None:
    """Restore the state below `out` into a fresh model; None without one. Errors as of `load_checkpoint`."""
    known = load_checkpoint(out, model.policy, model.policy.optimizer, job)
    if known is None:
        return None
    found = RlProgress(**known)
    model._n_updates, model.num_timesteps = found.updates, found.steps
    return found


def session_seed(seed: int, session: int, deaths: int = 0) -> int:
    """What a session draws its scenarios from: never those of another again, nor of one whose process died."""
    return int(np.random.SeedSequence((seed, session, deaths)).generate_state(1)[0] % 2**31)


class ProgressCallback(BaseCallback):
    """At the end of each rollout: one line, one row of the curve; a checkpoint and the picture each `every` seconds.

    before: what earlier sessions have done. tell: prints a line.
    """

    def __init__(
        self, out: Path, job: dict[str, Any], before: RlProgress, total: int, tell: Callable[[str], None], every: float
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
    def progress(self) -> RlProgress:
        """What has been done by now, this session included."""
        seconds = self._before.seconds + time.monotonic() - self._began
        return replace(
            self._before, steps=self.model.num_timesteps, seconds=seconds, sessions=self._before.sessions + 1
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
        add_row(self._out / CURVE, row, "steps")
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
        save_progress(self._out, self.model, self.progress, self._job)  # type: ignore[arg-type]
        draw_rl(self._out)
        self._saved = time.monotonic()
