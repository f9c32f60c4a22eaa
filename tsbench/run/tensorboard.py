"""A run in TensorBoard: shares of SCD while it goes on, and its figures at the end, below RUN/tensorboard."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from torch.utils.tensorboard import SummaryWriter

from tsbench.run.listener import Started
from tsbench.run.log.record import Row

if TYPE_CHECKING:
    from tsbench.run.session import RunResult


class TensorBoard:
    """`tensorboard --logdir RUN/tensorboard` shows it. The step of an episode is its number in this session."""

    def started(self, run: Started) -> None:
        self._writer = SummaryWriter(str(run.folder / "tensorboard"))
        self._writer.add_text("options", "\n\n".join(f"{name}: {value}" for name, value in run.options.items()))
        self._count, self._passed = Counter[str](), Counter[str]()

    def episode(self, row: Row) -> None:
        name = row["planner"]
        self._count[name] += 1
        self._passed[name] += bool(row["scd"])
        share = 100.0 * self._passed[name] / self._count[name]
        self._writer.add_scalar(f"episodes_with_scd/{name}", share, self._count[name])

    def finished(self, result: RunResult) -> None:
        for planner in () if result.summary is None else result.summary.planners:
            for part, scores in planner.scores.items():
                if scores.overall.main.value is not None:
                    self._writer.add_scalar(f"{part}/{planner.planner}", scores.overall.main.value)
        self._writer.close()
