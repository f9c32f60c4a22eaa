"""The terminal table of a run, and the same as Markdown: every score with its interval and its n."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich import box
from rich.console import Console
from rich.table import Table

from tsbench.metrics.aggregate import Figure, PlannerSummary, Summary
from tsbench.metrics.intervals import Estimate
from tsbench.report.analyses.markdown import markdown_row
from tsbench.signs.model import GROUPS

_DASH = "–"
_PLAIN = {
    "driving_score": "DS",
    "destination": "dest.\n%",
    "efficiency": "effic.\n%",
    "collision": "coll.\n%",
    "comfort": "comf.\n%",
    "engaged": "engag.\n%",
}
_KEY = (
    "SCD: sign-compliant and arrived, %, macro mean over types. ± reaches to the farther end of the 95 % "
    "interval (cluster bootstrap over maps; Wilson where maps do not differ); both ends are in summary.json."
)
_STRICT = "n: strict (error outcomes count as failures) / completed (episodes without an error outcome)."
_SHORT = {"priority": "prior.", "obstacles": "obst."}
_PLANNERS_ABREAST = 4


def print_table(summary: Summary, console: Console) -> None:
    """Print the main table and the table by type; readable at 100 columns."""
    console.print(_main(summary))
    console.print(_KEY, style="dim")
    console.print(_STRICT, style="dim")
    for line in (*_errors(summary), *_fewer(summary), *_no_interval(summary)):
        console.print(line, style="yellow", markup=False)
    contract = f"edition {summary.edition}, contract {summary.contract_hash}"
    console.print(contract, style="dim", markup=False, soft_wrap=True)
    for k in range(0, len(summary.planners), _PLANNERS_ABREAST):
        console.print(_by_type(summary, summary.planners[k : k + _PLANNERS_ABREAST]))


def _main(summary: Summary) -> Table:
    style = "bold yellow" if summary.partial else "bold"
    table = Table(
        title=summary.title, title_style=style, title_justify="left", box=box.SIMPLE_HEAD, show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )  # fmt: skip
    groups = _groups(summary)
    table.add_column("planner", overflow="fold", min_width=11, max_width=16)
    for head in ("SCD\nall", *(f"SCD\n{_SHORT.get(g, g)}" for g in groups), *_PLAIN.values()):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("n", justify="right", no_wrap=True)
    for p in summary.planners:
        rows = [True, False] if p.completed < p.recorded else [True]
        for strict in rows:
            label = _escape(p.planner) if strict else "  completed"
            cells = [_pick(p.overall, strict), *(_pick(p.groups.get(g), strict) for g in groups)]
            plain = [_pick(p.metrics[m], strict) for m in _PLAIN]
            n = f"{p.recorded}\n/ {p.completed}" if strict else str(p.completed)
            table.add_row(
                label, *(_with_reach(e) for e in cells), *(_number(e) for e in plain), n,
                style=None if strict else "dim", end_section=strict == rows[-1],
            )  # fmt: skip
    return table


def _by_type(summary: Summary, planners: Sequence[PlannerSummary]) -> Table:
    table = Table(
        title="SCD by type, % (strict, 95 % interval; below, where it differs: completed of their n)",
        title_justify="left", title_style="bold",
        box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0),
    )  # fmt: skip
    table.add_column("group")
    table.add_column("type", overflow="fold")
    for p in planners:
        table.add_column(_escape(p.planner), justify="right", overflow="fold", min_width=16, max_width=18)
    table.add_column("maps", justify="right")
    table.add_column("n", justify="right")
    last = ""
    for group, kind in _types(summary):
        figures = [p.types.get(kind) for p in planners]
        if not any(figures):
            continue
        cells = (_strict_and_completed(f, "\n") for f in figures)
        table.add_row(group if group != last else "", kind, *cells, *_rests_on(figures))
        last = group
    return table


def to_markdown(summary: Summary) -> str:
    """The main table and the one by type for a README: the same figures, with the ends of the intervals of SCD."""
    groups = _groups(summary)
    heads = [
        "planner",
        "SCD overall",
        *(f"SCD {g}" for g in groups),
        *(_flat(h) for h in _PLAIN.values()),
        "n",
    ]
    lines = [markdown_row(heads), f"|---|{'---:|' * (len(heads) - 1)}"]
    for p in summary.planners:
        for strict in [True, False] if p.completed < p.recorded else [True]:
            name = p.planner + ("" if strict else ", completed")
            scd = [_with_ends(_pick(f, strict)) for f in (p.overall, *(p.groups.get(g) for g in groups))]
            plain = [_number(_pick(p.metrics[m], strict)) for m in _PLAIN]
            n = f"{p.recorded} / {p.completed}" if strict else str(p.completed)
            lines.append(markdown_row([name, *scd, *plain, n]))
    fewer = "".join(f" {line.replace('|', '&#124;')}." for line in _fewer(summary))
    lines += [
        "",
        f"{summary.title}. {_KEY} {_STRICT}{fewer} Edition {summary.edition}, contract `{summary.contract_hash}`.",
        "",
    ]
    names = [p.planner for p in summary.planners]
    lines += [
        markdown_row(["group", "type", *names, "maps", "n"]),
        f"|---|---|{'---:|' * (len(names) + 2)}",
    ]
    for group, kind in _types(summary):
        figures = [p.types.get(kind) for p in summary.planners]
        cells = [*(_strict_and_completed(f, "; completed ") for f in figures), *_rests_on(figures)]
        lines.append(markdown_row([group, f"`{kind}`", *cells]))
    return "\n".join([*lines, ""])


def _groups(summary: Summary) -> list[str]:
    present = dict.fromkeys(g for p in summary.planners for g in p.groups)
    return [g for g in GROUPS if g in present] + sorted(g for g in present if g not in GROUPS)


def _types(summary: Summary) -> list[tuple[str, str]]:
    order = {g: k for k, g in enumerate(_groups(summary))}
    found = {(g, kind) for p in summary.planners for kind, g in p.type_groups.items()}
    return sorted(found, key=lambda pair: (order[pair[0]], pair[1]))


def _pick(figure: Figure | None, strict: bool) -> Estimate | None:
    if figure is None:
        return None
    # Metrics without a value for a failure have one figure only: that of the completed episodes.
    return figure.strict if strict and figure.strict is not None else figure.completed


def _rests_on(figures: Sequence[Figure | None]) -> tuple[str, str]:
    """Maps and episodes of a row's strict figures; where planners of a partial run differ, from least to most."""
    known = [_pick(figure, True) for figure in figures]
    maps, episodes = ([getattr(e, name) for e in known if e is not None] for name in ("clusters", "n"))
    texts = (f"{min(k)}" if min(k) == max(k) else f"{min(k)}–{max(k)}" for k in (maps, episodes))
    return next(texts), next(texts)


def _strict_and_completed(figure: Figure | None, between: str) -> str:
    """The strict figure, whose n is the row's; where it differs the completed one too, with its own n."""
    text = _with_ends(_pick(figure, True))
    if figure is None or figure.strict is None or figure.strict.n == figure.completed.n:
        return text
    return f"{text}{between}{_number(figure.completed)} of {figure.completed.n}"


def _number(estimate: Estimate | None) -> str:
    return _DASH if estimate is None or estimate.value is None else f"{estimate.value:.1f}"


def _with_reach(estimate: Estimate | None) -> str:
    if estimate is None or estimate.value is None:
        return _DASH
    return f"{estimate.value:.1f}\n" + (_DASH if estimate.reach is None else f"±{estimate.reach:.1f}")


def _with_ends(estimate: Estimate | None) -> str:
    if estimate is None or estimate.value is None:
        return _DASH
    if estimate.low is None or estimate.high is None:
        return f"{estimate.value:.1f} (–)"
    return f"{estimate.value:.1f} ({estimate.low:.1f}–{estimate.high:.1f})"


def _errors(summary: Summary) -> Iterator[str]:
    for p in summary.planners:
        bad = {
            k: n for k, n in p.outcomes.items() if n and k.endswith(("error", "planner_timeout", "output"))
        }
        if bad:
            text = ", ".join(f"{n} {kind}" for kind, n in bad.items())
            yield f"{p.planner}: {p.recorded - p.completed} error outcomes ({text}), causes in errors/"


def _fewer(summary: Summary) -> Iterator[str]:
    """Metrics that do not apply to every completed episode, with their own n."""
    for p in summary.planners:
        fewer = {m: p.metrics[m].completed.n for m in _PLAIN if p.metrics[m].completed.n < p.completed}
        if fewer:
            text = ", ".join(f"{m} {n}" for m, n in fewer.items())
            yield f"{p.planner}: of {p.completed} completed episodes these metrics apply to fewer: {text}"


def _no_interval(summary: Summary) -> Iterator[str]:
    for p in summary.planners:
        e = _pick(p.overall, True)
        if e is not None and e.value is not None and e.low is None:
            yield f"{p.planner}: no interval for the overall SCD: {e.reason}"


def _flat(head: str) -> str:
    return head.replace("\n", " ")


def _escape(name: str) -> str:
    return name.replace("[", r"\[")
