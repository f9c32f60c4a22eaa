"""A run in MLflow: `pip install mlflow`, then

tsbench run --planner idm --split dev --listener examples/mlflow_tracker.py:Mlflow
"""

from collections import Counter

import mlflow

from tsbench.run.listener import Started
from tsbench.run.log.record import Row
from tsbench.run.session import RunResult


class Mlflow:
    """While the run is on, the share of episodes with SCD by planner; at its end, every figure of the table."""

    def started(self, run: Started) -> None:
        mlflow.set_experiment("tsbench")
        mlflow.start_run(run_name=run.folder.name)
        mlflow.log_params({"edition": run.edition, "contract": run.contract, **run.options})
        self._count, self._passed = Counter[str](), Counter[str]()

    def episode(self, row: Row) -> None:
        name = row["planner"]
        self._count[name] += 1
        self._passed[name] += bool(row["scd"])
        share = 100.0 * self._passed[name] / self._count[name]
        mlflow.log_metric(f"episodes_with_scd/{name}", share, step=self._count[name])

    def finished(self, result: RunResult) -> None:
        for planner in () if result.summary is None else result.summary.planners:
            for part, scores in planner.scores.items():
                if scores.overall.main.value is not None:
                    mlflow.log_metric(f"{part}/{planner.planner}", scores.overall.main.value)
        mlflow.end_run("FINISHED" if result.status == "complete" else "KILLED")
