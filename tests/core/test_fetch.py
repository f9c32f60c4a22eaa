"""Fetching data: only the file that was asked for gets into place, from a folder and over HTTP."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path

import pytest
from command_line import in_process
from data_folder import in_force
from serving import serving

from tsbench.core import fetch
from tsbench.core.errors import InputError

Run = Callable[..., str]
CONTENT = {"scenarios/a b.parquet": b"rows" * 1000, "scenarios/scenes/train/x.parquet": bytes(3 << 20)}


@pytest.fixture
def origin(tmp_path: Path) -> Path:
    """A folder with the files, as `make package` lays it out."""
    folder = tmp_path / "origin"
    for name, content in CONTENT.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


class Handler(SimpleHTTPRequestHandler):
    """Serves a folder, silently; of a name that ends in .torn it sends less than it says."""

    asked: list[str] = []  # noqa: RUF012

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        self.asked.append(self.path)
        if self.path.endswith(".torn"):
            self.send_response(200)
            self.send_header("Content-Length", "4000")
            self.end_headers()
            self.wfile.write(b"rows")
            return
        super().do_GET()


@pytest.fixture
def address(origin: Path) -> Iterator[str]:
    """The same folder behind a server of this machine."""
    Handler.asked = []
    with serving(partial(Handler, directory=str(origin))) as server:
        yield server


@pytest.fixture
def known(tmp_path: Path) -> Iterator[Path]:
    """A manifest that knows these files as the set `train`, and an empty data folder in force, which is given."""
    files = [[name, len(content), hashlib.sha256(content).hexdigest()] for name, content in CONTENT.items()]
    told = {"schema_version": 1, "sets": {"train": {"about": "made up", "files": files}}}
    (tmp_path / "manifest.json").write_text(json.dumps(told), encoding="utf-8")
    root = tmp_path / "data"
    (root / "sign_catalog").mkdir(parents=True)
    with in_force(root) as patch:
        patch.setattr(fetch, "MANIFEST", tmp_path / "manifest.json")
        fetch.data_sets.cache_clear()
        yield root
    fetch.data_sets.cache_clear()


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `tsbench data`: what it prints, or its errors where it has to end with another code than 0."""
    command = in_process("data", capsys)
    return lambda *arguments, expect=0: command(*arguments, expect=expect)[expect > 0]


def files_below(root: Path) -> set[str]:
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}


@pytest.mark.parametrize("by", ["origin", "address"])
def test_all_files_come_from_a_folder_and_an_address(
    by: str, known: Path, request: pytest.FixtureRequest, run: Run
) -> None:
    source = str(request.getfixturevalue(by))
    assert run("list").splitlines()[1].split()[:4] == ["train", "2", "3.1", "2"]
    out = run("fetch", "--from", f"{source}/", "train")
    assert out.splitlines()[-1] == "train: 2 of 2 files fetched, all there"
    assert {name: (known / name).read_bytes() for name in files_below(known)} == CONTENT
    listed = run("list", "train").splitlines()
    assert [line.split()[0] for line in listed] == [hashlib.sha256(c).hexdigest() for c in CONTENT.values()]
    assert all(str(known) in line for line in listed)
    assert run("list").splitlines()[1].split()[:4] == ["train", "2", "3.1", "none"]


def test_what_is_there_is_not_fetched_again(known: Path, address: str, run: Run) -> None:
    first, second = CONTENT
    (known / first).parent.mkdir()
    (known / first).write_bytes(CONTENT[first])
    assert "1 of 2 files fetched" in run("fetch", "--from", address)
    assert Handler.asked == [f"/{second}"]


def test_another_file_in_the_place_is_not_overwritten(known: Path, origin: Path, run: Run) -> None:
    place = known / next(iter(CONTENT))
    place.parent.mkdir()
    place.write_bytes(b"mine")
    said = run("fetch", "--from", str(origin), expect=2)
    assert f"{place}: is another file than the train data's: move it away first" in said
    assert place.read_bytes() == b"mine"


@pytest.mark.parametrize("by", ["origin", "address"])
@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"Rows" * 1000, "has not the SHA-256"),
        (b"rows" * 1000 + b"!", "is larger than the 4000 bytes"),
        (b"rows" * 999, "ends after 3996 of 4000 bytes"),
        (None, "cannot be fetched"),
    ],
)
def test_a_wrong_file_is_one_line_and_leaves_nothing(
    by: str, content: bytes | None, problem: str, known: Path, origin: Path, request: pytest.FixtureRequest,
    run: Run,
) -> None:  # fmt: skip
    source, name = str(request.getfixturevalue(by)), "scenarios/a b.parquet"
    if content is None:
        (origin / name).unlink()
    else:
        (origin / name).write_bytes(content)
    said = run("fetch", "--from", source, "train", expect=2)
    assert said.count("\n") == 1
    assert said.startswith(f"error: {source}/scenarios/a")
    assert problem in said
    assert not files_below(known)


def test_a_fetch_goes_on_after_a_fault(known: Path, origin: Path, run: Run) -> None:
    first, second = CONTENT
    (origin / second).write_bytes(b"")
    assert second in run("fetch", "--from", str(origin), expect=2)
    assert files_below(known) == {first}
    (origin / second).write_bytes(CONTENT[second])
    assert "1 of 2 files fetched" in run("fetch", "--from", str(origin))


def test_a_server_that_hangs_up(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match=r"\.torn: (ends after 4 of 4000 bytes|cannot be fetched)"):
        fetch.fetch_file(f"{address}/x.torn", 4000, "0" * 64, tmp_path / "new" / "x")
    assert not files_below(tmp_path / "new")


def test_a_server_that_sends_without_end_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = tmp_path / "endless"
    endless.symlink_to("/dev/zero")
    with pytest.raises(InputError, match="is larger than the 10 bytes"):
        fetch.fetch_file(str(endless), 10, "0" * 64, tmp_path / "new" / "x")
    assert not files_below(tmp_path / "new")


def test_other_addresses_than_http_are_not_opened(known: Path, origin: Path, run: Run) -> None:
    assert "cannot be fetched" in run("fetch", "--from", f"file://{origin}", expect=2)


def test_unknown_names(known: Path, run: Run) -> None:
    assert "no data of the name 'wights': there are train" in run("list", "wights", expect=2)
    assert "no data of the name" in run("fetch", "--from", "x", "y", expect=2)
