"""`tsbench doctor` prints every finding, and its exit code says whether one failed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tsbench.cli import diagnosis as examine
from tsbench.cli import main
from tsbench.cli.diagnosis import Diagnosis, Status


@pytest.mark.parametrize(
    ("status", "code", "last"), [(Status.NOTE, 0, "nothing is in the way"), (Status.FAILED, 1, "failed: 1")]
)
def test_findings_and_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], status: Status, code: int, last: str
) -> None:
    def check() -> Iterator[Diagnosis]:
        yield Diagnosis(Status.OK, "Python", "fine")
        yield Diagnosis(status, "data", "a file [b]is[/b] gone", "bring it back")

    monkeypatch.setattr(examine, "CHECKS", {"all": check})
    with pytest.raises(SystemExit) as ended:
        main(["doctor"])
    assert ended.value.code == code
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["ok", "Python", "fine"]
    assert "a file [b]is[/b] gone" in lines[1]
    assert lines[2].strip() == "-> bring it back"
    assert lines[3] == last
