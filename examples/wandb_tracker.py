"""A run in Weights & Biases: `pip install wandb`, then

tsbench run --planner idm --split dev --listener examples/wandb_tracker.py:Wandb
"""

from collections import Counter

import wandb

from tsbench.run.listener import Started
from tsbench.run.log.record import Row
from tsbench.run.session import RunResult


class Wandb:
    """While the run is on, the share of episodes with SCD by planner; at its end, every figure of the table."""

    def started(self, run: Started) -> None:
        about = {"edition": run.edition, "contract": run.contract, **run.options}
        self._run = wandb.init(project="tsbench", name=run.folder.name, config=about)
        self._count, self._passed = Counter[str](), Counter[str]()

    def episode(self, row: Row) -> None:
        name = row["planner"]
        self._count[name] += 1
        self._passed[name] += bool(row["scd"])
        self._run.log({f"episodes_with_scd/{name}": 100.0 * self._passed[name] / self._count[name]})

    def finished(self, result: RunResult) -> None:
        for planner in () if result.summary is None else result.summary.planners:
            for part, scores in planner.scores.items():
                self._run.summary[f"{part}/{planner.planner}"] = scores.overall.main.value
        self._run.finish(exit_code=0 if result.status == "complete" else 1)
