"""Work in processes: in order, kept, resumed; what goes wrong ends it at once and loses nothing that was finished."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from patience import HANG_S, eventually

from tsbench.core.errors import InputError, TsbenchError
from tsbench.core.parallel import CachedResult, worker_processes


def square(number: int, log: Path) -> dict[str, Any]:
    with log.open("a") as file:
        file.write(f"{number}\n")
    if number == 7:
        raise InputError("seven is no number to square")
    if number == 13:
        os._exit(1)
    return {"square": number * number, "nan": math.nan, "pid": os.getpid()}


def squares(folder: Path, numbers: list[int], stamp: str = "a") -> list[int]:
    """In the order asked for; what was driven stands in the log, a line each."""
    jobs = [(number, folder / "log") for number in numbers]
    with worker_processes(2, "squaring") as pool:
        found = pool.ordered(square, jobs, lambda number, _: CachedResult(folder / "kept" / f"{number}.json", stamp))
        return [one["square"] for one in found]


def done(folder: Path) -> list[int]:
    return sorted(map(int, (folder / "log").read_text().split()))


def test_results_come_in_order_and_are_not_made_again(tmp_path: Path) -> None:
    numbers = [5, 3, 70, 1]
    assert squares(tmp_path, numbers) == [25, 9, 4900, 1]
    assert squares(tmp_path, [*numbers, 2]) == [25, 9, 4900, 1, 4]
    assert done(tmp_path) == [1, 2, 3, 5, 70]
    # Made from something else, it is another result.
    assert squares(tmp_path, [3], "b") == [9]
    assert done(tmp_path) == [1, 2, 3, 3, 5, 70]
    kept = CachedResult(tmp_path / "kept" / "3.json", "b").read()
    assert math.isnan(kept["nan"])
    assert kept["pid"] != os.getpid()


def test_more_than_can_be_under_way_at_once(tmp_path: Path) -> None:
    numbers = list(range(100, 300))
    assert squares(tmp_path, numbers) == [n * n for n in numbers]


def test_an_error_ends_it_and_what_was_finished_before_is_kept(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="seven"):
        squares(tmp_path, [1, 2, 7, *range(100, 400)])
    assert {p.stem for p in (tmp_path / "kept").iterdir()} == {"1", "2"}
    assert len(done(tmp_path)) < 303


def test_a_process_that_dies_is_said(tmp_path: Path) -> None:
    with pytest.raises(TsbenchError, match="a process died squaring; run the same command again"):
        squares(tmp_path, [13])


def test_a_kept_result_that_has_lost_what_belongs_to_it_is_made_again(tmp_path: Path) -> None:
    kept = CachedResult(tmp_path / "2.json", "a")
    kept.write({"square": 4})
    with worker_processes(1, "squaring") as pool:
        assert pool.start(square, 2, tmp_path / "log", kept=kept)() == {"square": 4}
        assert pool.start(square, 2, tmp_path / "log", kept=kept, sound=lambda _: False)()["square"] == 4
    assert done(tmp_path) == [2]


SLOW = """
import signal, sys, time
from pathlib import Path
from tsbench.core.parallel import CachedResult, worker_processes

def nap(number, log):
    with log.open("a") as file:
        file.write(f"{number}\\n")
    time.sleep(0.05)
    return [number]

if __name__ == "__main__":
    # Who runs the suite in the background may have it ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder = Path(sys.argv[1])
    jobs = ((number, folder / "log") for number in range(10_000))
    with worker_processes(2, "napping") as pool:
        for _ in pool.ordered(nap, jobs, lambda number, _: CachedResult(folder / "kept" / f"{number}.json", "")):
            pass
"""


def test_ctrl_c_ends_it_with_what_is_finished_kept_and_nobody_at_work(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(SLOW)
    command = [sys.executable, str(tmp_path / "slow.py"), str(tmp_path)]
    child = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)
    eventually((tmp_path / "kept" / "3.json").exists, child)
    os.killpg(child.pid, signal.SIGINT)
    told = child.communicate(timeout=HANG_S)[1]
    assert child.returncode != 0
    # The workers leave Ctrl-C to their parent: one traceback, its own.
    assert told.count("KeyboardInterrupt") == 1
    before = done(tmp_path)
    time.sleep(0.3)
    assert done(tmp_path) == before
    assert not list((tmp_path / "kept").glob(".*"))
