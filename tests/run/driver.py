"""`tsbench run` with the fake runner in place of the real one; takes the command line's arguments."""

from __future__ import annotations

import functools
from unittest.mock import patch

import tsbench.cli
import tsbench.cli.run as command
from tsbench.run.session import Options
from tsbench.run.workers import Limits

FAKE = functools.partial(
    Options, runner="fake_runner:FakeRunner", limits=Limits(call=1.0, first_call=1.5, phase=5.0, start=60.0)
)


def main(arguments: list[str] | None = None) -> None:
    with patch.object(command, "Options", FAKE):
        tsbench.cli.main(arguments)


if __name__ == "__main__":
    main()
