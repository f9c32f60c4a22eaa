"""What long commands say meanwhile: bars on a terminal, lines elsewhere."""

from __future__ import annotations

import pytest
from click.shell_completion import ShellComplete

from tsbench.cli import cli, console
from tsbench.cli.console import bars


def test_without_a_terminal_a_line_is_written_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 5.0, 20.0, 21.0, 22.0, 23.0, 60.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    with bars() as show:
        show("maps", 1, 2000)  # after 5 s: too early
        show("maps", 2, 2000)
        show("maps", 3, 2000)  # 1 s after the last line
        show("maps", 2000, 2000)  # the end of what was told
        show("quick", 9, 9)  # no line was about it
        show("scenes", 4, 9)
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines() == ["maps: 2 of 2,000", "maps: 2,000 of 2,000", "scenes: 4 of 9"]


@pytest.mark.parametrize(
    ("words", "typed", "found"),
    [
        (["run", "--planner"], "idm-", "idm-e"),
        (["run", "--types"], "yield,prio", "yield,priority"),
        (["run", "--types"], "round", "roundabout"),
        (["scenarios", "list", "--city"], "north", "north-bayreuth"),
        (["city", "show"], "ando", "andorra"),
        (["planners", "check"], "plant2-f", "plant2-ft"),
        (["compare", "runs/mine"], "plant2-f", "plant2-ft"),
        (["signs", "show"], "3.2", "3.24"),
        (["debug", "--planner"], "idm-", "idm-e"),
        (["debug", "--planner", "idm", "--scenario"], "yield-j-msk-04a5", "yield-j-msk-04a55f1db8-v0"),
        (["scenarios", "show"], "yield-j-msk-04a5", "yield-j-msk-04a55f1db8-v0"),
    ],
)
def test_the_shell_completes_names(words: list[str], typed: str, found: str) -> None:
    shell = ShellComplete(cli=cli, ctx_args={}, prog_name="tsbench", complete_var="_TSBENCH_COMPLETE")
    assert found in [item.value for item in shell.get_completions(words, typed)]
