"""The ray executor on a cluster of a head and two nodes, all on this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from patience import HANG_S, eventually
from run_helpers import Bench

RUN = ["run", "--planner", "fake_planners:Slow", "--planner", "fake_planners:Exits", "--split", "test"]
RUN += ["--trace", "all"]
# Ray's own processes get the time that a busy machine needs; nothing is reported home.
SETTINGS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_agent_register_timeout_ms": "600000"}
pytestmark = pytest.mark.slow


def patiently(start: Callable[..., Any], **arguments: Any) -> Any:
    """Ray gives a node half a minute to come up, which on a busy machine may take two tries."""
    for _ in range(3):
        try:
            return start(**arguments)
        except Exception as problem:
            if "timed out during startup" not in str(problem):
                raise
    return start(**arguments)


class OnCluster:
    """The command line on a cluster of our own; `local`: what the executor of this machine leaves."""

    def __init__(self, bench: Bench, cluster: Any) -> None:
        self.bench, self.cluster = bench, cluster
        bench.env |= {**SETTINGS, "RAY_ADDRESS": cluster.address}
        bench.run(*RUN, "--out", "local", "--workers", "1", expect=1)
        self.local = self.content("local")

    def content(self, name: str) -> dict[str, bytes]:
        """Results, traces and stories of errors by their place in the folder."""
        folder = self.bench.folder / name
        paths = [folder / "episodes.parquet", folder / "violations.parquet"]
        paths += [path for path in sorted((folder / "traces").rglob("*")) if not path.is_dir()]
        return {str(path.relative_to(folder)): path.read_bytes() for path in paths}

    def workers(self) -> list[int]:
        """Worker processes anywhere on this machine that were started for a run of ours, but for their own children."""
        parents = {}
        for place in Path("/proc").glob("[0-9]*"):
            try:
                command = (place / "cmdline").read_bytes()
                ours = b"tsbench.run.execution.worker_main" in command and b"reaper.py" not in command
                if ours and (place / "cwd").readlink() == self.bench.folder:
                    told = (place / "stat").read_text().rpartition(")")[2].split()
                    parents[int(place.name)] = int(told[1])
            except OSError:
                continue  # It has ended meanwhile.
        return [number for number, parent in parents.items() if parent not in parents]

    def assert_no_worker_is_left(self) -> None:
        eventually(lambda: not self.workers())


@pytest.fixture(scope="module")
def on(tmp_path_factory: pytest.TempPathFactory, make_data) -> Iterator[OnCluster]:
    # Here, not above: 30 MB in every process of the suite.
    ray_cluster = pytest.importorskip("ray.cluster_utils")
    folder = tmp_path_factory.mktemp("ray")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SETTINGS.items():
            patch.setenv(name, value)
        cluster = ray_cluster.Cluster()
        try:
            patiently(cluster.add_node, num_cpus=0)
            yield OnCluster(Bench(make_data(folder / "data"), folder), cluster)
        finally:
            cluster.shutdown()


def test_a_node_killed_in_the_middle(on: OnCluster) -> None:
    """Its episodes are given out again, none twice, and the bytes are those of the local executor."""
    stays, goes = (patiently(on.cluster.add_node, num_cpus=1) for _ in range(2))
    process = on.bench.start_paused(20, *RUN, "--executor", "ray", "--out", "killed")
    assert len(on.workers()) == 2
    on.cluster.remove_node(goes, allow_graceful=False)
    out, _ = on.bench.go(process, expect=1)
    assert "80 of 80 episodes finished, 1 with an error outcome" in out
    assert on.content("killed") == on.local
    on.assert_no_worker_is_left()
    on.cluster.remove_node(stays)


def test_a_run_killed_leaves_no_process_and_is_continued_without_the_cluster(on: OnCluster) -> None:
    node = patiently(on.cluster.add_node, num_cpus=1)
    process = on.bench.start_paused(10, *RUN, "--executor", "ray", "--out", "dead", "--workers", "1")
    assert on.workers()
    process.kill()
    process.communicate()
    on.assert_no_worker_is_left()
    on.cluster.remove_node(node)
    done = on.bench.run(*RUN, "--out", "dead", expect=1)
    assert "continuing: 10 of 80 episodes are already there" in done.stderr
    assert on.content("dead") == on.local


@pytest.mark.parametrize(
    ("given", "words"),
    [({}, "the cluster at "), ({"RAY_ADDRESS": "127.0.0.1:1"}, "no cluster at '127.0.0.1:1' ")],
    ids=["without a core", "not there"],
)
def test_no_cluster_to_run_on(on: OnCluster, given: dict[str, str], words: str) -> None:
    # The nodes that the tests before took away count until the cluster has noticed.
    on.cluster.wait_for_nodes()
    process = on.bench.start(*RUN, "--executor", "ray", "--out", "none", **given)
    _, err = process.communicate(timeout=HANG_S)
    assert process.returncode == 2
    assert err.startswith(f"error: --executor ray: {words}")
    assert err.count("\n") == 1
