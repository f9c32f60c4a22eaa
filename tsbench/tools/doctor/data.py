"""SUMO and the data: one simulation starts, and files are those that the tables name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import fetch_hint
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.tools.doctor.finding import REPAIR, Diagnosis, Status, alone, installed

SAMPLE = 200


def check_sumo() -> Iterator[Diagnosis]:
    """Its packages must be of one version, and a scene of the test split must start."""
    there = installed(("libsumo", "sumolib", "eclipse-sumo"))  # the last comes with the extra `make`
    told = ", ".join(f"{name} {number}" for name, number in there.items())
    if not {"libsumo", "sumolib"} <= there.keys() or len(set(there.values())) != 1:
        yield Diagnosis(Status.FAILED, "SUMO", f"its packages do not belong together: {told}", REPAIR)
        return
    code, words = alone("from tsbench.tools.doctor.data import simulate; simulate()")
    if code:
        yield Diagnosis(Status.FAILED, "SUMO", f"{told}; a simulation does not start: {words}", REPAIR)
    else:
        yield Diagnosis(Status.OK, "SUMO", f"{told}; {words}")


def simulate() -> None:
    """Load the first scene of the test split and step it for a second; prints what it did."""
    from tsbench.scenarios.scene_loader import load_scene
    from tsbench.scenarios.table import read_table, table_path
    from tsbench.sim.sumo import Simulation

    try:
        spec = read_table(table_path("test"))[0]
        scene, sim = load_scene(spec), Simulation()
        sim.load_scene(scene)
        for _ in range(10):
            sim.step()
        print(f"a simulation started ({spec.scenario_id}, {len(sim.fleet())} vehicles after 1 s)")
    except InputError as problem:
        sys.exit(str(problem))


def check_data() -> Iterator[Diagnosis]:
    """Catalogue, pool and tables can be read; all scene files are there, and a sample has the hashes of its rows."""
    from tsbench.scenarios.map_pool import known_map_ids, pool_file
    from tsbench.scenarios.table import SPLITS, read_table, table_path
    from tsbench.signs.catalog import load_catalog

    catalog, maps = load_catalog(), known_map_ids(pool_file())
    signs = f"{len(catalog.signs)} signs, {len(catalog.types)} types, {len(maps)} maps"
    yield Diagnosis(Status.OK, "data", f"{pool_file().parent.parent}: {signs}")
    for split in SPLITS:
        path = table_path(split)
        if not path.is_file():
            remedy = f"needed for --split {split} only: {fetch_hint(split)}"
            yield Diagnosis(Status.NOTE, "data", f"{path}: not there", remedy)
            continue
        rows = sorted(read_table(path), key=lambda row: row.scenario_id)
        lost = [row for row in rows if row.map_id not in maps]
        if lost:
            text = f"{path}: map {lost[0].map_id} of {lost[0].scenario_id} is not in the pool"
            yield Diagnosis(Status.FAILED, "data", text, "fetch the repository's data again")
            continue
        yield _files(path, rows)


def check_edition() -> Iterator[Diagnosis]:
    """Are rules, scenes, code and versions those that were released, and are the certificates those of the rows?"""
    from tsbench.run.contract import SCORING
    from tsbench.run.edition import LOCAL, contract_now, earlier_splits, edition_here, standing_contract
    from tsbench.scenarios.certificates import bases, certificates_path, read_certificates
    from tsbench.scenarios.table import read_table, splits_there, table_path

    earlier = earlier_splits()
    for split in splits_there():
        if split in earlier:
            text = f"the scenes of the {split} split are of {earlier[split]}"
            yield Diagnosis(Status.NOTE, "edition", text, "tsbench scenarios build makes those of today")
            continue
        contract = standing_contract(contract_now(split))
        name = edition_here(contract)
        text = f"{name}, contract of the {split} split {contract}"
        if name.endswith(LOCAL):
            yield Diagnosis(
                Status.NOTE, "edition", f"{text}: rules, scenes, code or versions are not those released",
                "scores compare with runs of this very installation only",
            )  # fmt: skip
        else:
            yield Diagnosis(Status.OK, "edition", text)
    path = certificates_path()
    if not path.is_file():
        yield Diagnosis(Status.NOTE, "edition", f"{path}: not there", "tsbench scenarios build makes it")
        return
    there = [split for split in splits_there() if split not in earlier]
    rows = [row for split in there for row in read_table(table_path(split))]
    certificates = {c.scenario_id: c for c in read_certificates(path)}
    known = {name: certificate.basis for name, certificate in certificates.items()}
    void = [name for name, basis in bases(rows).items() if known.get(name) != basis]
    judged = sorted({certificates[row.scenario_id].scoring for row in rows if row.scenario_id in known})
    if void:
        text = f"{path}: {len(void)} rows without a certificate of what they are, first {void[0]}"
        yield Diagnosis(Status.FAILED, "edition", text, "tsbench scenarios certify drives them again")
        return
    text = f"{len(rows)} rows, each with a certificate of what it is"
    if judged in ([], [SCORING]):
        yield Diagnosis(Status.OK, "edition", text)
    else:
        text += f", judged by scoring {', '.join(map(str, judged))}; this is scoring {SCORING}"
        yield Diagnosis(Status.NOTE, "edition", text, "tsbench scenarios certify drives them again")


def _files(table: Path, rows: list[ScenarioSpec]) -> Diagnosis:
    """All files that the rows name are in the stores, and a sample of them has the rows' hashes."""
    from tsbench.core.xmlfile import sha256
    from tsbench.scenarios.store import SceneStore, store_path

    split, store = table.stem, SceneStore(table.parent)
    folder = store_path(split, "", table.parent).parent
    if not folder.is_dir():
        # Only those of the test split come with the package.
        status = Status.FAILED if split == "test" else Status.NOTE
        return Diagnosis(status, "data", f"{folder}: no scene files here", fetch_hint(split))
    there = {kind: store.names(split, kind) for kind in sorted({row.pair_type for row in rows})}
    nets = {row.net: (row, row.net_sha256) for row in rows}
    named = nets | {row.additional: (row, row.additional_sha256) for row in rows}
    missing = [name for name, (row, _) in named.items() if name not in there[row.pair_type]]
    sample = [name for name in list(named)[:: max(len(named) // SAMPLE, 1)] if name not in missing]
    changed = [name for name in sample if sha256(store.read(named[name][0], name).content) != named[name][1]]
    if not missing and not changed:
        text = (
            f"{table.name}: {len(rows)} scenarios, all {len(named)} scene files there, {len(sample)} hashed"
        )
        return Diagnosis(Status.OK, "data", text)
    first = (missing or changed)[0]
    told = f"{len(missing)} scene files missing, {len(changed)} of {len(sample)} hashed ones changed"
    where = store_path(split, named[first][0].pair_type, table.parent) / first
    remedy = "fetch the repository's data again; tsbench scenarios verify names every file"
    return Diagnosis(Status.FAILED, "data", f"{table.name}: {told}, first {where}", remedy)
