"""`tsbench view`: reports of runs on the loopback interface, their players packed when they are asked for.

The other half of a failure without a trace is driven again in a process of its own. Nothing of an address ever becomes
a path: it names a run by its number, an episode by its row, a network by a hash that an episode named before, a plate
by its key in the catalogue. Only requests that name this very host are answered, so that no page of another site can
read runs through a name that resolves to this machine.
"""

from __future__ import annotations

import json
import re
import socket
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from tsbench.core.errors import InputError, TsbenchError
from tsbench.core.parallel import worker_processes
from tsbench.report.analyses.run_pool import EpisodeIndex, RunPool, index_episodes, read_pool
from tsbench.report.page.episode_player import EpisodePacker, pack_plate
from tsbench.report.page.page_format import render_page
from tsbench.report.page.report_page import drive_again, served_page
from tsbench.run.log.journal import JOURNAL, lines_so_far
from tsbench.run.log.manifest import NAME, read_manifest
from tsbench.run.log.read import is_run

HOST = "127.0.0.1"
_RUN = re.compile(r"/run/(\d{1,6})/")
_STATE = re.compile(r"/run/(\d{1,6})/state")
_DATA = re.compile(r"/run/(\d{1,6})/data/(episode|roads|plate)/([^/]{1,80})")
_HTML, _TEXT, _JSON = "text/html; charset=utf-8", "text/plain; charset=utf-8", "application/json"
_PACKED = "application/octet-stream"


class NotThere(Exception):
    """What was asked for does not exist: one line for the answer."""


@dataclass
class OpenedRun:
    """A run with its page, which is made on request.

    mark: of its manifest and journal. A run that goes on is read again for its next page; the data that a page asks for
    are of what it shows.
    """

    mark: tuple[tuple[int, int], ...]
    pool: RunPool
    index: EpisodeIndex
    packer: EpisodePacker
    page: bytes = b""
    roads: dict[str, bytes] = field(default_factory=dict)


class Library:
    """The runs that are served, read when first asked for. Of the threads that ask, one at a time reads a run."""

    def __init__(self, runs: Sequence[Path]) -> None:
        self.runs = tuple(runs)
        self._opened: dict[int, OpenedRun] = {}
        self._locks = [threading.Lock() for _ in self.runs]

    def index(self) -> bytes:
        rows = [{"number": k, "path": str(path), **_told(path)} for k, path in enumerate(self.runs)]
        return render_page("runs.html", title="tsbench runs", runs=rows, served=True).encode()

    def page(self, number: int) -> bytes:
        """A run's report. Raises NotThere, and InputError for a run that cannot be read."""
        with self._lock(number):
            run = self._open(number, again=True)
            run.page = run.page or served_page(run.pool, run.index, f"/run/{number}/data/").encode()
            return run.page

    def state(self, number: int) -> bytes:
        """How a run stands, as JSON: what its line in the list shows. Raises NotThere."""
        with self._lock(number):
            return json.dumps(_told(self.runs[number])).encode()

    def data(self, number: int, kind: str, name: str) -> bytes:
        """Packed data of a run's page. Raises NotThere, and InputError for a trace that cannot be shown."""
        with self._lock(number):
            run = self._open(number)
            if kind == "episode":
                return self._episode(run, name)
            if kind == "plate":
                try:
                    return pack_plate(run.index.data.artwork(), name)
                except ValueError as problem:
                    raise NotThere(f"plate {name}: {problem}") from None
            if name not in run.roads:
                raise NotThere(f"no roads {name}")
            return run.roads[name]

    def _lock(self, number: int) -> threading.Lock:
        if number >= len(self.runs):
            raise NotThere(f"no run {number}")
        return self._locks[number]

    def _episode(self, run: OpenedRun, name: str) -> bytes:
        row = int(name) if name.isascii() and name.isdecimal() else -1
        if row not in run.index.within_reach:
            raise NotThere(f"no trace of episode {name}")
        key, path = run.index.key(row), run.index.trace(row)
        home = run.index.homes[key[0]]
        if not path.is_file():
            with worker_processes(1, "driving an episode again") as again:
                again.start(drive_again, home, key)()
        if not path.resolve().is_relative_to(home.resolve()):
            raise NotThere(f"the trace of episode {name} lies outside its run")
        packed = run.packer.pack(path, key)
        run.roads[packed.net] = packed.roads
        return packed.episode

    def _open(self, number: int, again: bool = False) -> OpenedRun:
        """again: what was opened before counts only if nothing was added to the run."""
        path = self.runs[number]
        if not is_run(path):
            raise NotThere(f"{path}: no run folder any more")
        mark = tuple(_state(file) for file in (path / NAME, path / JOURNAL))
        opened = self._opened.get(number)
        if opened is None or (again and opened.mark != mark):
            pool = read_pool([path], allow_partial=True, under_way=True)
            index = index_episodes(pool)
            opened = self._opened[number] = OpenedRun(mark, pool, index, EpisodePacker(index.data))
        return opened


def _state(path: Path) -> tuple[int, int]:
    """What changes where a file is written to; a journal goes when its run ends."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return 0, 0
    return found.st_mtime_ns, found.st_size


def _told(path: Path) -> dict[str, Any]:
    """A run's line in the list: what its manifest says, or why it cannot be read."""
    try:
        manifest = read_manifest(path)
        if manifest is None:
            return {"problem": "no run folder any more"}
        counts = manifest.get("counts") or {}
        if manifest["status"] == "running":
            asked = len(manifest["planners"]) * manifest["effective"].get("scenarios", 0)
            counts = {"asked": asked, "finished": len(lines_so_far(path / JOURNAL))}
        told = {name: manifest.get(name, "") for name in ("status", "started", "contract")}
        told |= {"problem": "", "planners": ", ".join(p["name"] for p in manifest["planners"])}
        return told | {"asked": counts.get("asked"), "finished": counts.get("finished")}
    except InputError as problem:
        return {"problem": str(problem)}


def make_server(runs: Sequence[Path], port: int) -> ThreadingHTTPServer:
    """A server of `runs` on the loopback interface; port 0: any that is free. Raises InputError."""
    library = Library(runs)

    class Handler(_Handler):
        shelf = library

    try:
        return _Server((HOST, port), Handler)
    except OSError as problem:
        raise InputError(f"port {port}: {problem.strerror or problem}; choose another with --port") from None


def runs_below(folder: Path) -> list[Path]:
    """The run folders in a folder. Raises InputError if there is no run."""
    found = sorted(path for path in folder.glob("*") if is_run(path)) if folder.is_dir() else []
    if not found:
        raise InputError(f"{folder}: no run folders in it; name some: tsbench view RUN…")
    return found


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """The client has gone away: no answer is needed."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    shelf: Library
    server_version, sys_version = "tsbench", ""
    protocol_version = "HTTP/1.1"
    # s, for each piece of a request, and for all of it.
    timeout = 30

    def handle_one_request(self) -> None:
        self._deadline = threading.Timer(self.timeout, self._hear_no_more)
        self._deadline.daemon = True
        self._deadline.start()
        try:
            super().handle_one_request()
        finally:
            self._deadline.cancel()

    def _hear_no_more(self) -> None:
        # The client may have gone away already.
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RD)

    def do_GET(self) -> None:
        self._deadline.cancel()
        try:
            self._answer(HTTPStatus.OK, *self._find())
        except NotThere as problem:
            self._answer(HTTPStatus.NOT_FOUND, _TEXT, f"{problem}\n".encode())
        except TsbenchError as problem:
            self._answer(HTTPStatus.UNPROCESSABLE_ENTITY, _TEXT, f"{problem}\n".encode())

    do_HEAD = do_GET  # noqa: N815

    def _find(self) -> tuple[str, bytes]:
        host, port = self.connection.getsockname()[:2]
        if self.headers.get_all("Host") not in ([f"{host}:{port}"], [f"localhost:{port}"]):
            raise NotThere("this server answers only to its own address")
        path = unquote(urlsplit(self.path).path)
        if path == "/":
            return _HTML, self.shelf.index()
        if found := _RUN.fullmatch(path):
            return _HTML, self.shelf.page(int(found[1]))
        if found := _STATE.fullmatch(path):
            return _JSON, self.shelf.state(int(found[1]))
        if found := _DATA.fullmatch(path):
            return _PACKED, self.shelf.data(int(found[1]), found[2], found[3])
        raise NotThere("nothing here")

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "X-Frame-Options": "DENY",
            "Cross-Origin-Resource-Policy": "same-origin",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """The terminal stays quiet: the answer says what went wrong."""
