"""`tsbench view`: on the loopback interface only, for its own host only, and never a path from an address."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import page_runs
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import in_process, refused
from forgeries import change_manifest
from page_runs import HOSTILE, TRACED
from patience import HANG_S
from test_page_format import unpack

from tsbench.cli import main
from tsbench.core.errors import InputError
from tsbench.episode.trace import trace_path
from tsbench.report.page import report_sections
from tsbench.report.page import report_server as serving
from tsbench.report.page.episode_player import EpisodePacker
from tsbench.report.page.report_server import make_server, runs_below
from tsbench.run.log.journal import JOURNAL, encode
from tsbench.run.log.record import TABLES, TIMING


@pytest.fixture(scope="module", autouse=True)
def no_charts() -> Iterator[None]:
    """Drawing is what takes time, and the tests of pages look at charts."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(report_sections, "inline_svg", lambda *_: "")
        yield


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return page_runs.make_run(tmp_path / "run")


@contextmanager
def served(*runs: Path, packer: Callable[..., EpisodePacker] = page_runs.packer) -> Iterator[int]:
    """The port of a server of these runs, whose scenes are all the handmade one unless packed by another."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(serving, "EpisodePacker", packer)
        server = make_server(runs, 0)
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.fixture
def port(run: Path, tmp_path: Path) -> Iterator[int]:
    with served(run, tmp_path / "gone") as port:
        yield port


@pytest.fixture(scope="module")
def one_port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """For tests that change nothing."""
    folder = tmp_path_factory.mktemp("served")
    with served(page_runs.make_run(folder / "run"), folder / "gone") as port:
        yield port


def ask(port: int, path: str, host: str | None = None, method: str = "GET") -> tuple[int, str, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=HANG_S)
    connection.putrequest(method, path, skip_host=True)
    connection.putheader("Host", host or f"127.0.0.1:{port}")
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.getheader("Content-Type") or "", body


def test_it_listens_on_the_loopback_interface_only(run: Path) -> None:
    server = make_server([run], 0)
    try:
        assert server.server_address[0] == "127.0.0.1"
        with pytest.raises(InputError, match="choose another with --port"):
            make_server([run], server.server_address[1])
    finally:
        server.server_close()


def test_pages_and_data(one_port: int) -> None:
    status, kind, body = ask(one_port, "/")
    assert (status, kind) == (200, "text/html; charset=utf-8")
    assert b'<a href="/run/0/">' in body
    assert b"no run folder any more" in body
    status, _, body = ask(one_port, "/run/0/")
    assert status == 200
    assert b"/run/0/data/" in body
    assert b"connect-src &#39;self&#39;" in body
    assert b"<img src=x" not in body
    rows = sorted((planner, scenario) for planner in page_runs.PLANNERS for scenario in TRACED)
    found = {}
    for row in range(96):
        status, kind, body = ask(one_port, f"/run/0/data/episode/{row}")
        if status == 200:
            assert kind == "application/octet-stream"
            header = unpack(body)[0]
            found[row] = (header["planner"], header["scenario"])
    assert sorted(found.values()) == rows
    assert HOSTILE in {planner for planner, _ in found.values()}
    status, _, body = ask(one_port, f"/run/0/data/roads/{header['roads']}" if found else "/")
    assert status == (200 if header["roads"] else 404)
    status, _, body = ask(one_port, "/run/0/data/plate/3.24%7C40")
    assert unpack(body)[0]["svg"].startswith("<svg")
    status, _, body = ask(one_port, "/run/0/", method="HEAD")
    assert (status, body) == (200, b"")


def test_a_run_that_is_driven_shows_what_is_finished(run: Path) -> None:
    lines = under_way(run)
    journal = run / JOURNAL
    with served(run) as port:
        status, _, body = ask(port, "/run/0/")
        assert (status, b"no episode is finished yet" in body) == (422, True)
        journal.write_bytes(encode({"run": "this"}) + b"".join(lines[:1]))
        assert b"1 of 96" in ask(port, "/")[2]
        status, kind, body = ask(port, "/run/0/state")
        state = json.loads(body)
        assert (status, kind) == (200, "application/json")
        assert (state["status"], state["finished"], state["asked"]) == ("running", 1, 96)
        assert ask(port, "/run/0/")[0] == 200
        assert unpack(ask(port, "/run/0/data/episode/0")[2])[0]["scenario"] == TRACED[0]
        assert players(port) == 1
        # A torn line is no episode. What the page shows stays what it was until it is loaded again.
        journal.write_bytes(encode({"run": "this"}) + b"".join(lines) + lines[0][:-9])
        assert players(port) == 1
        assert b"96 of 96" in ask(port, "/")[2]
        assert json.loads(ask(port, "/run/0/state")[2])["finished"] == 96
        assert ask(port, "/run/0/")[0] == 200
        assert players(port) == 4
        # The run ends while its page is open.
        journal.unlink()
        assert players(port) == 4


def players(port: int) -> int:
    """How many episodes of the page that was loaded last can be played."""
    return sum(ask(port, f"/run/0/data/episode/{row}")[0] == 200 for row in range(96))


def under_way(run: Path) -> list[bytes]:
    """Make a finished run one that has only begun; the lines that its journal would have, those with traces first."""
    episodes, events, _ = (pq.read_table(run / name).to_pylist() for name in TABLES)
    for name in TABLES:
        (run / name).unlink()
    change_manifest(run, status="running", files=None, counts=None, finished=None)
    (run / JOURNAL).write_bytes(encode({"run": "this"}))
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for row in sorted(episodes, key=lambda row: (row["scenario_id"] not in TRACED, row["scenario_id"])):
        key = {name: row[name] for name in ("planner", "scenario_id")}
        timing = {field.name: "" if field.type == pa.string() else 0 for field in TIMING} | key
        found[*key.values()] = {"row": row, "events": [], "timing": timing, "trace": ""}
    for event in events:
        found[event["planner"], event["scenario_id"]]["events"].append(event)
    return [encode(line) for line in found.values()]


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd", "/run/0/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd",
        "/run/0/data/episode/..%2F..%2Frun.json", "/run/0/data/episode/%2Fetc%2Fpasswd",
        "/run/0/data/episode/-1", "/run/0/data/episode/1e3", "/run/0/data/episode/99999", "/run/0/data/episode/%D9%A3",
        "/run/0/data/roads/..", "/run/0/data/roads/" + "f" * 64, "/run/0/run.json", "/run/0/traces/idm",
        "/run/0/data/plate/3.24%7Cx", "/run/0/data/plate/3.24%7Cnan", "/run/7/", "/run/1/", "/run/0",
        "/run/7/state", "/favicon.ico",
    ],
)  # fmt: skip
def test_other_addresses_name_nothing(one_port: int, path: str) -> None:
    status, kind, body = ask(one_port, path)
    assert status in (404, 422)
    assert kind.startswith("text/plain")
    assert b"root:" not in body
    assert b"schema_version" not in body
    assert len(body) < 300


def test_the_other_half_of_a_failure_is_driven_again(tmp_path: Path) -> None:
    run = tmp_path / "driven"
    with pytest.raises(SystemExit, match="0"):
        main(["run", "--planner", "idm", "--split", "dev", "--types", "yield", "--limit", "1", "--out", str(run)])
    (failed,) = (run / "traces" / "idm").iterdir()
    with served(run, packer=EpisodePacker) as port:
        answers = [ask(port, f"/run/0/data/episode/{row}") for row in (0, 1, 2)]
    assert [status for status, _, _ in answers] == [200, 200, 404]
    halves = {header["scenario"]: header["which"] for header in (unpack(body)[0] for _, _, body in answers[:2])}
    assert halves == {failed.stem: "signed half", f"{failed.stem}-c": "contrast half"}
    assert len(list(failed.parent.iterdir())) == 2


def test_a_half_that_cannot_be_driven_again_says_why(tmp_path: Path) -> None:
    with served(page_runs.make_pair_run(tmp_path / "pairs")) as port:
        answers = [ask(port, f"/run/0/data/episode/{row}") for row in range(96)]
    (why,) = (body.decode() for status, _, body in answers if status == 422)
    assert f"idm/{TRACED[1]}-c has no trace and cannot be driven again: the run has another contract" in why
    assert sum(status == 200 for status, _, _ in answers) == 3


def test_a_link_out_of_the_run_is_not_followed(port: int, run: Path, tmp_path: Path) -> None:
    inside = trace_path(run, "idm", TRACED[0])
    outside = tmp_path / "secret.parquet"
    inside.rename(outside)
    inside.symlink_to(outside)
    answers = [ask(port, f"/run/0/data/episode/{row}") for row in range(48)]
    assert sum(status == 200 for status, _, _ in answers) == 1
    assert sum(b"lies outside its run" in body for _, _, body in answers) == 1


def test_other_hosts_and_methods_are_refused(one_port: int) -> None:
    for host in ("example.org", f"example.org:{one_port}", "127.0.0.1", f"127.0.0.1:{one_port + 1}"):
        status, _, body = ask(one_port, "/run/0/", host=host)
        assert status == 404
        assert b"only to its own address" in body
    assert ask(one_port, "/", host=f"localhost:{one_port}")[0] == 200
    assert ask(one_port, "/", method="POST")[0] == 501


def test_two_hosts_are_none(one_port: int) -> None:
    own = f"Host: 127.0.0.1:{one_port}\r\n"
    for hosts in (own + own, own + "Host: example.org\r\n", "Host: example.org\r\n" + own, ""):
        with socket.create_connection(("127.0.0.1", one_port), timeout=HANG_S) as line:
            line.sendall(f"GET / HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n".encode())
            assert b" 404 " in line.makefile("rb").readline()


def test_a_request_that_does_not_end_is_given_up(one_port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """However often a byte of it comes: each one alone is in time."""
    monkeypatch.setattr(serving._Handler, "timeout", 1.0)
    with socket.create_connection(("127.0.0.1", one_port), timeout=HANG_S) as line:
        line.sendall(b"GET / HTTP/1.1\r\n")
        end, given_up = time.monotonic() + HANG_S, False
        while time.monotonic() < end and not given_up:
            try:
                line.sendall(b"X")
            except ConnectionError:
                given_up = True
            time.sleep(0.05)
        assert given_up


def test_a_bad_trace_and_a_bad_run_say_why(port: int, run: Path) -> None:
    torn = trace_path(run, "idm", TRACED[0])
    torn.write_bytes(torn.read_bytes()[:300])
    bodies = [ask(port, f"/run/0/data/episode/{row}") for row in range(48)]
    assert sum(status == 422 and b"cannot be read as a trace" in body for status, _, body in bodies) == 1
    (run / "run.json").write_text("{}")
    status, _, body = ask(port, "/run/0/")
    assert status == 422
    assert b"not the manifest of a tsbench run" in body
    assert b"not the manifest of a tsbench run" in ask(port, "/")[2]


def test_who_goes_away_leaves_no_traceback(port: int, capfd: pytest.CaptureFixture[str]) -> None:
    for request in ("GET / HTTP/1.1", "GET /run/0/ HTTP/1.1", "GET /nothing HTTP/1.1", "GET /run/0/da"):
        with socket.create_connection(("127.0.0.1", port)) as line:
            # Closing at once with a reset, whatever comes.
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            line.sendall(f"{request}\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    # Answered after all of them: one run is read by one thread at a time.
    assert ask(port, "/run/0/")[0] == 200
    assert capfd.readouterr().err == ""


def test_a_slow_page_does_not_hold_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [page_runs.make_run(tmp_path / name) for name in ("slow", "quick")]
    begun, go = threading.Event(), threading.Event()

    def slow_page(pool, index, data):
        if data.startswith("/run/0/"):
            begun.set()
            assert go.wait(60)
        return f"page of {data}"

    monkeypatch.setattr(serving, "served_page", slow_page)
    with served(*runs) as port, ThreadPoolExecutor() as threads:
        slow = threads.submit(ask, port, "/run/0/")
        assert begun.wait(60)
        try:
            assert ask(port, "/")[0] == 200
            assert ask(port, "/run/1/")[2] == b"page of /run/1/data/"
            assert ask(port, "/run/1/data/plate/3.24%7C40")[0] == 200
            assert not slow.done()
        finally:
            go.set()
        assert slow.result()[2] == b"page of /run/0/data/"


def test_which_runs(tmp_path: Path, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert runs_below(tmp_path) == [run]
    with pytest.raises(InputError, match="no run folders in it"):
        runs_below(run)
    assert "no run folder (it has no run.json)" in refused(in_process("view", capsys), str(tmp_path))
