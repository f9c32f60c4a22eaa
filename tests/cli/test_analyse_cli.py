"""`tsbench analyse` on run folders made by hand: what it prints and writes, and what it refuses."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
from command_line import refused
from PIL import Image
from run_builders import CONTRACT, episode, episodes, failed, lost, make_run

from tsbench.report.analyses import columns
from tsbench.report.analyses.analysis import ALL, write_analysis
from tsbench.report.analyses.run_analyses import analyse_runs
from tsbench.report.analyses.run_pool import read_pool
from tsbench.report.analyses.scd_statistics import metric_mean
from tsbench.signs.catalog import load_catalog

KINDS = ("main", "types", "intervals", "failures", "correlations", "ablation")


def stuck() -> dict[str, Any]:
    return {"scd": False, "destination": False, "outcome": "timeout", "route_completion": 40.0, "driving_score": 40.0}


def crashed() -> dict[str, Any]:
    return lost() | {"destination": False, "outcome": "collision", "collision": True, "driving_score": 30.0}


def four(folder: Path, **effective: Any) -> Path:
    """Four planners of 48 episodes each; ppo has an error outcome, mine[1] is a name of its own."""
    rows = episodes("idm", yield_m0_v0=lost(), yield_m1_v1=crashed(), yield_m2_v0=stuck(), speed_limit_m0_v0=stuck())
    rows += episodes("idm-e")
    rows += episodes("ppo", yield_m0_v0=lost(), yield_m0_v1=lost(), speed_limit_m1_v0=failed("boom"))
    rows += episodes("mine[1]_$x$", yield_m3_v0=crashed())
    return make_run(folder, rows, **effective)


def every_type(folder: Path) -> Path:
    """Three planners with an episode of every type."""
    rows = [
        episode(planner, 0, 0, 0)
        | {"scenario_type": kind.id, "group": kind.group, "scenario_id": f"{kind.id}-m0-v0", "map_id": kind.id}
        for planner in ("idm", "idm-e", "mine")
        for kind in load_catalog().types
    ]
    return make_run(folder, rows)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_main_is_strict_and_completed(analyse, tmp_path: Path) -> None:
    four(tmp_path / "r")
    out, _ = analyse("main", "r", "--out", "out")
    assert out.startswith("Main table: 2 of 29 types, 192 episodes asked, test split, variants all\n")
    assert f"contract {CONTRACT}" in out
    rows = table(tmp_path / "out" / "main.csv")
    assert [(r["planner"], r["figure"]) for r in rows] == [
        ("idm", "strict"), ("ppo", "strict"), ("ppo", "completed"), ("idm-e", "strict"), ("mine[1]_$x$", "strict"),
    ]  # fmt: skip
    strict, completed = rows[1:3]
    # Yield 22 of 24; speed limit 23 of 24, without the error 23 of 23.
    assert float(strict["signed_scd_overall"]) == pytest.approx(100 * (22 / 24 + 23 / 24) / 2, abs=1e-6)
    assert float(completed["signed_scd_overall"]) == pytest.approx(100 * (22 / 24 + 1) / 2, abs=1e-6)
    assert (strict["n"], completed["n"], completed["signed_scd_speed_n"]) == ("48", "47", "23")
    assert {r["contract"] for r in rows} == {CONTRACT}
    assert "mine[1]_$x$" in out
    assert r"mine[1]\_\$x\$" in (tmp_path / "out" / "main.tex").read_text()


def test_published_figures_stand_beside_all_types_of_the_test_split_alone(
    analyse, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every_type(tmp_path / "whole")
    four(tmp_path / "some")
    note = "published: "
    for command in ("main", "intervals"):
        other, _ = analyse(command, "whole", "--out", "other-out")
        with monkeypatch.context() as patch:
            patch.setattr(columns, "is_of_study", lambda contract: contract == CONTRACT)
            whole, _ = analyse(command, "whole", "--out", "whole-out")
            some, _ = analyse(command, "some", "--out", "some-out")
        assert (note in whole, note in some, note in other) == (True, False, False)
    rows = {(r["planner"], r["figure"]): r for r in table(tmp_path / "whole-out" / "main.csv")}
    theirs = rows["idm", "published"]
    assert (theirs["signed_scd_overall"], theirs["driving_score"], theirs["n"]) == ("7.2", "35.7", "")
    assert ("mine", "published") not in rows
    first = table(tmp_path / "whole-out" / "intervals.csv")[0]
    assert (first["planner"], first["group"], first["published"]) == ("idm", "all types", "7.2")


def test_several_runs_give_one_table(analyse, tmp_path: Path) -> None:
    four(tmp_path / "all")
    make_run(tmp_path / "one", episodes("idm", yield_m0_v0=lost(), yield_m1_v1=crashed(), yield_m2_v0=stuck(),
                                        speed_limit_m0_v0=stuck()))  # fmt: skip
    make_run(tmp_path / "two", episodes("idm-e"))
    analyse("main", "all", "--out", "x")
    analyse("main", "two", "one", "--out", "y")
    together, apart = (
        {r["planner"]: r for r in table(tmp_path / f / "main.csv") if r["figure"] == "strict"} for f in "xy"
    )
    for name in ("idm", "idm-e"):
        kept = {key: cell for key, cell in together[name].items() if key != "title"}
        assert kept == {key: cell for key, cell in apart[name].items() if key != "title"}


def test_types_have_n_for_every_planner(analyse, tmp_path: Path) -> None:
    four(tmp_path / "r")
    out, _ = analyse("types", "r", "--out", "out")
    rows = table(tmp_path / "out" / "types.csv")
    assert [(r["type"], r["figure"]) for r in rows] == [
        ("yield", "strict"), ("speed_limit", "strict"), ("speed_limit", "completed"),
    ]  # fmt: skip
    assert [r["ppo_count"] for r in rows] == ["24", "24", "23"]
    assert float(rows[0]["idm"]) == pytest.approx(100 * 21 / 24, abs=1e-6)
    assert "87.5" in out


def test_failures_are_all_there_is(analyse, tmp_path: Path) -> None:
    four(tmp_path / "r")
    analyse("failures", "r", "--out", "out")
    rows = {(r["planner"], r["group"], r["figure"]): r for r in table(tmp_path / "out" / "failures.csv")}
    idm = rows["idm", "all types", "strict"]
    counts = {"complied_arrived": 44, "complied_not_arrived": 2, "violated_arrived": 1, "violated_not_arrived": 1,
              "error": 0, "complied_timeout": 2, "complied_collision": 0, "violated_collision": 1}  # fmt: skip
    for name, count in counts.items():
        assert float(idm[name]) == pytest.approx(100 * count / 48, abs=1e-6), name
        assert idm[f"{name}_n"] == idm["n"] == "48"
    for key, row in rows.items():
        shares = [float(row[name] or 0) for name in list(counts)[:5]]
        assert sum(shares) == pytest.approx(100, abs=1e-5), key
    assert float(rows["ppo", "speed", "strict"]["error"]) == pytest.approx(100 / 24, abs=1e-6)
    assert (rows["ppo", "speed", "completed"]["n"], rows["ppo", "speed", "completed"]["error"]) == ("23", "")
    assert ("ppo", "priority", "completed") not in rows


def test_intervals_say_what_they_rest_on(analyse, tmp_path: Path) -> None:
    four(tmp_path / "r")
    analyse("intervals", "r", "--out", "out")
    rows = table(tmp_path / "out" / "intervals.csv")
    first = rows[0]
    assert (first["planner"], first["group"], first["n"], first["places"]) == ("idm", "all types", "48", "12")
    assert (first["method"], first["published"]) == ("effective sample size", "")
    assert float(first["scd_low"]) < float(first["scd"]) < float(first["scd_high"])


def test_correlations_are_over_planners(analyse, tmp_path: Path) -> None:
    four(tmp_path / "r")
    out, _ = analyse("correlations", "r", "--out", "out")
    assert "Conventional metrics and signed SCD over 4 planners" in out
    assert "fewer than 5 planners: no interval" in out
    rows = {(r["group"], r["metric"], r["figure"]): r for r in table(tmp_path / "out" / "correlations.csv")}
    score = rows["all types", "driving_score", "strict"]
    assert (score["planners"], score["nine"], score["study"]) == ("4", "", "")
    # Strict SCD: idm-e > mine > ppo > idm; strict driving score in the same order.
    assert float(score["rho"]) == 1.0
    assert rows["all types", "comfort", "strict"]["rho"] == ""


def test_means_by_group_are_those_of_the_summary(tmp_path: Path) -> None:
    pool = read_pool([four(tmp_path / "r")], False)
    for p in pool.summaries:
        for metric in ("driving_score", "collision", "comfort", "mean_speed"):
            figure = p.metrics[metric]
            strict = figure.completed if figure.strict is None else figure.strict
            assert metric_mean(pool.records[p.planner], ALL, metric, "strict") == pytest.approx(strict.value)
            completed = metric_mean(pool.records[p.planner], ALL, metric, "completed")
            assert completed == pytest.approx(figure.completed.value)


def test_ablation_pairs_by_scenario(analyse, tmp_path: Path) -> None:
    plain = episodes("idm-e", yield_m0_v0=lost())
    kept = [row for row in episodes("idm-e") if row["variant"] == 0]
    masked = [row | (lost() if row["scenario_type"] == "yield" else {}) for row in kept]
    make_run(tmp_path / "plain", plain + episodes("ppo"))
    make_run(tmp_path / "masked", masked, mask_signs=True, variants="one-per-map")
    out, _ = analyse("ablation", "masked", "plain", "--out", "out")
    assert out.startswith("Sign-channel ablation: 12 paired episodes for each of 1 planners, test split, variants ")
    assert "without a partner, left out: ppo" in out
    rows = {r["metric"]: r for r in table(tmp_path / "out" / "ablation.csv")}
    yields = rows["signed SCD, priority"]
    assert [yields[k] for k in ("n", "lost", "gained", "places")] == ["6", "5", "0", "6"]
    assert float(yields["difference"]) == pytest.approx(-500 / 6, abs=1e-5)
    assert yields["p"] == "0.0625"
    assert yields["mde"] != ""
    assert rows["signed SCD, speed"]["difference"] == "0.0"


def test_ablation_needs_both_and_the_same_scenes(analyse, tmp_path: Path) -> None:
    make_run(tmp_path / "plain", episodes("idm", maps=5))
    make_run(tmp_path / "masked", episodes("idm"), mask_signs=True)
    make_run(tmp_path / "other", episodes("ppo"), mask_signs=True)
    make_run(tmp_path / "elsewhere", episodes("idm"), mask_signs=True, contract="d" * 64)
    assert "none with it was given" in refused(analyse, "ablation", "plain")
    assert "none without it was given" in refused(analyse, "ablation", "masked")
    assert "idm has not driven 8 of the 48 scenes of masked" in refused(analyse, "ablation", "plain", "masked")
    assert "no planner is in both: without --mask-signs idm; with it ppo" in refused(
        analyse, "ablation", "plain", "other"
    )
    assert "d" * 64 in refused(analyse, "ablation", "plain", "elsewhere")


@pytest.mark.parametrize("kind", KINDS)
def test_partial_runs_are_refused_or_titled(analyse, tmp_path: Path, kind: str) -> None:
    rows = [row for name in ("idm", "idm-e", "ppo") for row in episodes(name)]
    make_run(tmp_path / "part", rows[:-2], asked=48)
    make_run(tmp_path / "masked", rows, mask_signs=True)
    runs = ("part", "masked") if kind == "ablation" else ("part",)
    assert "scenarios without a record (ppo: 2 of 48)" in refused(analyse, kind, *runs)
    assert not (tmp_path / "analyses").exists()
    out, _ = analyse(kind, *runs, "--allow-partial")
    assert out.startswith("PARTIAL, 2 episodes missing: ")
    assert all(row["title"].startswith("PARTIAL, 2 ") for row in table(tmp_path / "analyses" / f"{kind}.csv"))
    assert r"\caption{PARTIAL, 2 episodes missing: " in (tmp_path / "analyses" / f"{kind}.tex").read_text()


def test_runs_that_do_not_belong_together(analyse, tmp_path: Path) -> None:
    make_run(tmp_path / "a", episodes("idm"))
    make_run(tmp_path / "b", episodes("ppo"), contract="d" * 64)
    make_run(tmp_path / "c", episodes("ppo", maps=5))
    make_run(tmp_path / "d", episodes("ppo"), mask_signs=True)
    make_run(tmp_path / "e", episodes("idm"))
    assert f"a has contract {CONTRACT}, b has {'d' * 64}" in refused(analyse, "main", "a", "b")
    assert "a and c have different scenarios (scenarios: 48, 40)" in refused(analyse, "main", "a", "c")
    assert "signs are masked in one of a and d only" in refused(analyse, "main", "a", "d")
    assert "planner idm is in a and in e: give it once only" in refused(analyse, "main", "a", "e")
    assert "no run folder" in refused(analyse, "main", "nowhere")
    assert "at least 3 are needed, the runs have 1" in refused(analyse, "correlations", "a")


@pytest.mark.parametrize("kind", ["types", "intervals", "correlations", "ablation"])
def test_figures_are_drawn(tmp_path: Path, kind: str) -> None:
    runs = [four(tmp_path / "r")]
    if kind == "ablation":
        runs.append(four(tmp_path / "m", mask_signs=True))
    written = write_analysis(analyse_runs(kind, runs, allow_partial=False), tmp_path / "x")
    assert [path.suffix for path in written] == [".csv", ".tex", ".md", ".png", ".svg"]


def test_the_same_figures_are_the_same_bytes(tmp_path: Path) -> None:
    analysis = analyse_runs("failures", [four(tmp_path / "r")], allow_partial=False)
    first, second = (write_analysis(analysis, tmp_path / folder) for folder in "xy")
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes()
    with Image.open(tmp_path / "x" / "failures.png") as picture:
        assert picture.width > 800
