"""Where a command writes: plain ASCII, closed streams, full ones, readers that have gone. None gives a traceback."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsbench.cli import main
from tsbench.core.streams import progress_console, standard_streams

COMMAND = f"{sys.executable} -c 'from tsbench.cli import main; main()'"
# A table by rich.
LIST = "signs list"


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """A line of bash, in which `tsbench` is the command line of this checkout."""
    script = f'set -o pipefail; tsbench() {{ {COMMAND} "$@"; }}; {line}'
    return subprocess.run(["bash", "-c", script], env={**os.environ, **environment}, capture_output=True, check=False)


@pytest.mark.parametrize("command", [LIST, "--help"])
def test_a_full_disk_is_one_line(command: str) -> None:
    done = shell(f"tsbench {command} >/dev/full")
    assert done.stderr == b"error: standard output: No space left on device\n"
    assert done.returncode == 1


def test_a_closed_stream_takes_all() -> None:
    done = shell(f"tsbench {LIST} >&-")
    assert (done.returncode, done.stderr) == (0, b"")
    done = shell("tsbench --help 2>&- <&-")
    assert done.returncode == 0
    assert done.stdout


def test_a_reader_that_has_gone_needs_no_line() -> None:
    # `head` has ended when the command begins to write.
    done = shell(f"{{ sleep 0.3; tsbench {LIST}; }} | head -0")
    assert (done.returncode, done.stderr) == (1, b"")


def test_ascii() -> None:
    done = shell(f"tsbench {LIST}", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    plain = done.stdout.decode("ascii").splitlines()
    assert len(plain) == len(shell(f"tsbench {LIST}").stdout.decode().splitlines())


def test_errors_of_input_keep_their_code() -> None:
    line = "tsbench run --planner idm --split dev --types ф"
    assert shell(f"{line} 2>/dev/full").returncode == 2
    assert shell(f"{line} >&- 2>&-").returncode == 2
    done = shell(line, PYTHONIOENCODING="ascii")
    assert done.returncode == 2
    assert done.stderr.startswith(b"error: --types ?: no such type")


def test_a_run_goes_on_where_nobody_can_be_told(tmp_path: Path) -> None:
    line = "tsbench run --planner idm --split dev --limit 1 --workers 1 --out"
    done = shell(f"{line} {tmp_path}/full >/dev/full 2>/dev/full")
    assert done.returncode == 1
    done = shell(f"{line} {tmp_path}/closed >&- 2>&-")
    assert done.returncode == 0
    for name in ("full", "closed"):
        assert json.loads((tmp_path / name / "run.json").read_text())["status"] == "complete"


def test_a_call_from_python_goes_on(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        'import tsbench\nif __name__ == "__main__":\n'
        '    print(tsbench.evaluate("idm", split="dev", limit=1, workers=1, out="run").status)\n'
    )
    for place in ("2>/dev/full", "2>&-"):
        done = shell(f"cd {tmp_path}; rm -rf run; {sys.executable} mine.py {place}")
        assert (done.returncode, done.stdout) == (0, b"complete\n")


def test_what_stands_in_for_a_character(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script = (
        "from tsbench.core.streams import standard_streams\n"
        "with standard_streams():\n    print('5 m/s², é – … ×3 → жж \\udc80')"
    )
    for encoding, wanted in (
        ("ascii", b"5 m/s2, e - ~ x3 > ?? ?\n"),
        ("latin-1", "5 m/s², é - ~ ×3 > ?? ?\n".encode("latin-1")),
        ("utf-8", "5 m/s², é – … ×3 → жж ?\n".encode()),
    ):
        monkeypatch.setenv("PYTHONIOENCODING", encoding)
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
        assert (done.stdout, done.stderr) == (wanted, b"")


def test_streams_of_somebody_else_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    mine = io.StringIO()
    monkeypatch.setattr(sys, "stdout", mine)
    monkeypatch.setattr(sys, "stderr", mine)
    with standard_streams():
        assert sys.stdout is sys.stderr is mine
        progress_console().print("told")
    assert sys.stdout is sys.stderr is mine
    assert mine.getvalue() == "told\n"


def test_as_a_module_it_is_the_same_command(capsys: pytest.CaptureFixture[str]) -> None:
    for words, code in ((["--help"], 0), (["run", "--split", "moon", "--planner", "idm"], 2)):
        with pytest.raises(SystemExit) as ended:
            main(words)
        told = capsys.readouterr()
        done = subprocess.run([sys.executable, "-m", "tsbench", *words], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (ended.value.code, told.out, told.err)
        assert ended.value.code == code
