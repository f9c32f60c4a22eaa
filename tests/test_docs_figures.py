"""Figures that stand in the prose of pages, against the data and the tables that they are about."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from statistics import fmean
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from tsbench.core.fetch import data_sets
from tsbench.planners import registry
from tsbench.scenarios.certificates import read_certificates

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
MEGABYTE = 1_000_000
SPLITS = ("train", "dev", "holdout", "test")


def text_of(page: str) -> str:
    """A page's text, each run of blanks as one: its sentences break anywhere."""
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def cells(page: str, first: str) -> list[str]:
    """The other cells of the one row of a page's tables that begins with `first`."""
    (line,) = re.findall(
        rf"^\| {re.escape(first)} \| (.*) \|$", (ROOT / page).read_text(encoding="utf-8"), re.M
    )
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)]


def halves(split: str) -> tuple[int, int]:
    """Signed rows of a split, and contrast rows."""
    column = pq.read_table(ROOT / f"scenarios/{split}.parquet", columns=["half"])["half"]
    count = {value["values"]: value["counts"] for value in pc.value_counts(column).to_pylist()}
    return count["signed"], count["contrast"]


def test_the_splits_have_the_rows_that_the_pages_say() -> None:
    every = 0
    for split in SPLITS:
        signed, contrast = halves(split)
        rows = signed + contrast
        assert cells("docs/scenarios.md", f"`{split}`") == [f"{n:,}" for n in (signed, contrast, rows)]
        every += rows
    assert f"There are {every:,} rows".replace(",", " ") in text_of("docs/spec/scenes.md")
    signed, contrast = halves("test")
    assert f"{signed + contrast:,} episodes each ({signed:,} signed and {contrast:,} contrast" in text_of(
        "docs/cluster.md"
    )
    assert f"a small split: {sum(halves('dev'))} scenes" in text_of("README.md")
    nominal = (signed // 10, contrast // 10)
    assert f"({nominal[0]} signed halves, {nominal[1]} contrast halves)" in text_of("README.md")
    assert f"({nominal[0]} signed and {nominal[1]} contrast halves, " in text_of("docs/results.md")
    assert all(f"{sum(nominal):,}" in text_of(page) for page in ("README.md", "docs/index.md"))


@pytest.mark.parametrize(("run", "planner"), [("entrants", "metadrive-ppo"), ("pdm", "pdm")])
def test_drivers_of_others_do_what_their_page_says(run: str, planner: str) -> None:
    """Of docs/adapters.md: means over the types, in %."""
    found = pq.read_table(
        ROOT / f"results/{run}/episodes.parquet", columns=["planner", "scenario_id", "outcome", "scd"]
    ).to_pylist()
    assert {one["planner"] for one in found} == {planner}

    def mean(figure: Callable[[dict[str, Any]], bool], contrast: bool) -> float:
        of_type = defaultdict[str, list[bool]](list)
        for one in found:
            if one["scenario_id"].endswith("-c") == contrast:
                of_type[one["scenario_id"].partition("-")[0]].append(figure(one))
        return 100.0 * fmean(map(fmean, of_type.values()))

    arrived = [mean(lambda one: one["outcome"] == "arrived", contrast) for contrast in (False, True)]
    passed = [mean(lambda one: one["scd"], contrast) for contrast in (False, True)]
    ends = Counter(one["outcome"] for one in found)
    (signed, contrast), (ours, theirs) = arrived, passed
    said = {
        "metadrive-ppo": f"arrives in {signed:.0f} % of the signed halves and has {ours:.1f} % signed SCD. In the "
        f"contrast halves it arrives in {contrast:.0f} % and has {theirs:.1f} %.",
        "pdm": f"arrives in {signed:.0f} % of the signed halves and in {contrast:.0f} % of the contrast halves. Of "
        f"{len(found):,} episodes, {ends['collision']} end in a collision and {ends['off_road']} off the road. It has "
        f"{theirs:.1f} % SCD in contrast halves, {ours:.1f} % in signed ones",
    }
    assert said[planner] in text_of("docs/adapters.md")


def test_the_pool_has_the_maps_that_the_pages_say() -> None:
    pool = pq.read_table(ROOT / "sumo_nets/pool.parquet", columns=["family"])["family"]
    maps = f"{len(pool):,}"
    for page in ("docs/maps.md", "docs/differences.md"):
        assert maps in text_of(page)
    rings = pc.sum(pc.equal(pool, "roundabout")).as_py()
    assert cells("docs/maps.md", "roundabout ring")[-1] == str(rings)


def test_the_scene_stores_are_as_large_as_the_page_says() -> None:
    stores = sorted((ROOT / "scenarios/scenes").rglob("*.parquet"))
    files = sum(pq.read_metadata(store).num_rows for store in stores)
    packed = sum(store.stat().st_size for store in stores) / MEGABYTE
    assert f"{files:,} files" in text_of("docs/scenarios.md")
    assert f"{packed:.1f} MB" in text_of("docs/scenarios.md")


def test_the_planners_are_as_many_as_the_pages_say() -> None:
    make = (ROOT / "Makefile").read_text(encoding="utf-8")
    bases = re.findall(r"^(?:STYLES|NETWORKS) := (.*)$", make, re.M)
    named = {name + end for name in " ".join(bases).split() for end in ("", "-e")}
    assert named <= set(registry.names())
    assert len(named) == 16
    for page, number in (
        ("docs/spec/planners.md", "Seventeen are evaluated"),
        ("docs/results.md", "the sixteen planners of the first two lines"),
        ("docs/cluster.md", "Seventeen planners on the whole test split"),
    ):
        assert number in text_of(page)


def test_the_files_of_a_clone_are_as_large_as_the_page_says() -> None:
    told = int(cells("docs/install.md", "files of a clone")[0].split()[0])
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = [ROOT / name for name in tracked.stdout.split("\0") if name]
    size = sum(file.stat().st_size for file in files if file.is_file()) / MEGABYTE
    assert told == pytest.approx(size, rel=0.02)


@pytest.mark.parametrize("name", ["train", "holdout", "oracle"])
def test_data_sets_are_as_large_as_the_page_says(name: str) -> None:
    size = sum(file.size for file in data_sets()[name].files) / MEGABYTE
    assert cells("docs/install.md", f"`{name}`")[0] == f"{size:.1f} MB"


def test_rows_that_were_hard_to_prove_are_as_many_as_the_page_says() -> None:
    """Drawn anew, or solved by another expert than `idm-e`: of the test split."""
    drawn, solved = Counter[bool](), Counter[bool]()
    experts = Counter[str]()
    for proof in read_certificates(ROOT / "scenarios/certificates.parquet"):
        if proof.split == "test":
            signed = not proof.scenario_id.endswith("-c")
            drawn[signed] += proof.attempt > 0
            solved[signed] += proof.expert != "idm-e"
            experts[proof.expert] += 1
    text = text_of("docs/failures.md")
    assert f"{drawn[True]} signed and {drawn[False]} contrast rows are not the first draw" in text
    assert f"{solved.total()} of the {experts.total():,} rows are solved by" in text
    assert f"`idm-s3-e` ({experts['idm-s3-e']}) or `idm-s4-e` ({experts['idm-s4-e']}) only" in text
    assert f"only: {solved[True]} signed rows and {solved[False]} contrast rows" in text


def test_frames_in_the_prose_are_those_of_the_table() -> None:
    *_, drives, frames = cells("docs/finetuning.md", "all")[:4]
    each = int(frames.replace(",", "")) / int(drives)
    text = text_of("docs/finetuning.md")
    assert f"There are some {each:.0f} frames a drive" in text
    assert f"2,000 drives are some {2000 * round(each):,} frames" in text


def test_traces_in_the_prose_are_as_large_as_in_the_table() -> None:
    kilobytes = int(cells("docs/cluster.md", "a trace")[0].split()[0])
    found = re.search(r"leave a trace: ([\d,]+) traces, ([\d.]+) GB", text_of("docs/cluster.md"))
    assert found is not None
    assert float(found[2]) == pytest.approx(int(found[1].replace(",", "")) * kilobytes / 1e6, abs=0.05)


def test_paths_of_data_on_the_data_card_exist() -> None:
    named = re.findall(
        r"`([\w/]+\.(?:parquet|json|yaml|md))`", (DOCS / "data-card.md").read_text(encoding="utf-8")
    )
    assert named
    there = {path.name: path for top in ("scenarios", "sumo_nets") for path in (ROOT / top).glob("*.*")}
    assert [name for name in named if not (ROOT / name).is_file() and name not in there] == []


@pytest.mark.slow
def test_the_page_of_figures_is_that_of_the_data(tmp_path: Path) -> None:
    page = tmp_path / "dataset.md"
    done = subprocess.run(
        [sys.executable, "-c", "from tsbench.cli import main; main()", "scenarios", "stats", "--markdown", str(page)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert page.read_bytes() == (DOCS / "dataset.md").read_bytes(), (
        "tsbench scenarios stats --markdown docs/dataset.md"
    )
