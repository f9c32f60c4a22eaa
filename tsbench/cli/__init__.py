"""The command line: every group is imported when it is used, so that `tsbench --help` stays fast."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from tsbench import __version__
from tsbench.core.errors import InputError, TsbenchError, load, missing_extra
from tsbench.core.machine import collect_garbage_seldom
from tsbench.core.streams import STDOUT, standard_streams
from tsbench.core.text import did_you_mean

# By section of --help: command, where it is, and its line there.
SECTIONS = {
    "Use": {
        "run": ("tsbench.cli.run:run", "Run planners on scenarios, or continue a run."),
        "campaign": ("tsbench.cli.run:campaign", "Drive the runs that a file lists, with one table."),
        "compare": ("tsbench.cli.report:compare", "Compare planners, scenario by scenario."),
        "failures": ("tsbench.cli.report:failures", "List the episodes that failed, and why each did."),
        "report": ("tsbench.cli.report:report", "Write one HTML page about runs."),
        "view": ("tsbench.cli.report:view", "Look at runs in a browser on this machine."),
        "render": ("tsbench.cli.episodes:render", "Draw episodes of a run as PNG, GIF or MP4."),
        "analyse": ("tsbench.cli.analyse:analyse", "The paper's tables and figures from runs."),
        "rescore": ("tsbench.cli.run:rescore", "Recompute all verdicts from the saved traces."),
        "export": ("tsbench.cli.episodes:export", "Write episodes as CommonRoad XML or MCAP."),
        "submit": ("tsbench.cli.leaderboard:submit", "Make one file of a run, for the leaderboard."),
        "verify": ("tsbench.cli.leaderboard:verify", "Drive a claim's episodes again and compare."),
        "leaderboard": ("tsbench.cli.leaderboard:leaderboard", "A site of submissions."),
        "signs": ("tsbench.cli.signs:signs", "Look at the sign catalogue."),
        "doctor": ("tsbench.cli.doctor:doctor", "Check the installation, the data and this machine."),
    },
    "Bring a planner of your own": {
        "planners": ("tsbench.cli.planners:planners", "List planners, check one of your own."),
        "debug": ("tsbench.cli.debug:debug", "Drive one episode in this process: breakpoints work."),
        "train": ("tsbench.cli.train:train", "Train a learned planner."),
        "oracle": ("tsbench.cli.oracle:oracle", "Collect and choose the drives that plant2-ft learns from."),
        "bench": ("tsbench.cli.bench:bench", "Measure the speed of this machine."),
    },
    "Make the data": {
        "data": ("tsbench.cli.data:data", "The data that tsbench knows; fetch what is missing."),
        "city": ("tsbench.cli.city:city", "A data set of another city, from its OpenStreetMap extract."),
        "seal": ("tsbench.cli.city:seal", "A data set drawn with a secret, committed to before it is published."),
        "maps": ("tsbench.cli.maps:maps", "From OpenStreetMap extracts to a pool of maps."),
        "scenarios": ("tsbench.cli.scenarios:scenarios", "Build, verify and look at scenarios."),
    },
}
EXIT_FAILED, EXIT_INPUT, EXIT_NOT_COMPARABLE, EXIT_INTERRUPTED = 1, 2, 3, 130


class LazyGroup(click.Group):
    """A group whose commands are imported on use; `lazy`: by section of --help and name, where it is and its line."""

    def __init__(self, *args: Any, lazy: Mapping[str, Mapping[str, tuple[str, str]]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._sections = lazy

    @property
    def _lazy(self) -> dict[str, tuple[str, str]]:
        return {name: command for section in self._sections.values() for name, command in section.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self._lazy)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in self._lazy:
            return None
        module, _, attribute = self._lazy[cmd_name][0].partition(":")
        command: click.Command = getattr(load(module), attribute)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command, and the options that the folder's tsbench.toml gives it."""
        if args and not args[0].startswith("-") and args[0] not in self._lazy:
            ctx.fail(f"No such command '{args[0]}'{did_you_mean(args[0], self._lazy)}.")
        name, command, rest = super().resolve_command(ctx, args)
        if name is not None and command is not None and Path("tsbench.toml").is_file():
            from tsbench.cli.config import defaults_of, telling

            ctx.default_map = {name: defaults_of(command, [name, *rest])}
            command = telling(command)
        return name, command, rest

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        width = max(map(len, self._lazy))
        for title, commands in self._sections.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), line) for name, (_, line) in commands.items()])


@click.group(cls=LazyGroup, lazy=SECTIONS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="tsbench")
def cli() -> None:
    """Does a self-driving planner obey the traffic sign in front of it, and still arrive?"""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 errors, holes or broken off, 2 bad input, 3 verdicts equal but
    bytes not comparable, 130 interrupted.
    """
    collect_garbage_seldom()
    with standard_streams():
        code = _code_of(lambda: cli.main(args=arguments, prog_name="tsbench", standalone_mode=False))
        # What was printed last has to arrive, too.
        code = _code_of(sys.stdout.flush) or code
    sys.exit(code)


def _code_of(call: Callable[[], object]) -> int:
    """The exit code of a call; its errors are told in a line."""
    try:
        code = call()
    except SystemExit as ended:
        code = ended.code
    except InputError as problem:
        return _failed(str(problem))
    except TsbenchError as problem:
        return _failed(str(problem), EXIT_FAILED)
    except ModuleNotFoundError as problem:
        told = missing_extra(problem)
        if told is None:
            raise
        return _failed(str(told))
    except click.exceptions.NoArgsIsHelpError as problem:
        problem.show()
        return EXIT_INPUT
    except click.ClickException as problem:
        where = getattr(problem, "ctx", None)
        hint = f" (see {where.command_path} --help)" if where is not None else ""
        return _failed(problem.format_message() + hint)
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted", err=True)
        return EXIT_INTERRUPTED
    except OSError as problem:
        # A file or folder that cannot be used as it was asked for, or standard output.
        if problem.filename is None:
            raise
        if problem.filename == STDOUT:
            # A reader that has gone (`| head`) needs no line.
            gone = isinstance(problem, BrokenPipeError)
            return EXIT_FAILED if gone else _failed(f"{STDOUT}: {problem.strerror}", EXIT_FAILED)
        return _failed(f"{problem.filename}: {problem.strerror}")
    return code if isinstance(code, int) else 0


def _failed(message: str, code: int = EXIT_INPUT) -> int:
    line = " ".join(message.split())
    # A file may name half of a pair of code units, which no terminal takes.
    click.echo(f"error: {line.encode(errors='backslashreplace').decode()}", err=True)
    return code
