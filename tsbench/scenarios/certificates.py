"""Certificates: what driving a scenario row proved about it. `scenarios/certificates.parquet`, one row per scenario.

Source: docs/scenes.md, "Certificates". The drives are above this layer (`dataset.certify`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, fields_of, read_rows, save_rows
from tsbench.core.provenance import data_hash, digest, versions
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.mirror import mirrored_id
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.convoy import LATE_BRAKE_MPS2

SCHEMA_VERSION = 4
DENSITY_TOLERANCE = 0.25
# Times are sums of ticks.
_TIME_TOLERANCE_S = 1e-6


@dataclass(frozen=True, slots=True)
class Certificate:
    """What is known of one row.

    attempt: which draw of the variant was kept (0 = the first). expert: the privileged expert that arrived without a
    violation, "" if none did; expert_time_s: its driving time (NaN if none). blind_baseline: the sign-blind driver;
    blind_outcome: how its episode ended; tempting: it did not get SCD; engaged: the rule bound it.
    asked_density, realised_density: moving cars per lane-km (0 without traffic). road_users: how many others the
    blind baseline met. overlaps: pairs of others whose bodies overlap deeply at some tick. arrival_gap_s: the task
    agent's unhindered arrival at the conflict zone less the ego's (NaN without a convoy). error: one line if an episode
    broke off. digest: SHA-256 of both episodes. basis: what they were driven on (`bases`); one of another
    basis says nothing. scoring: number of the scoring (`run.edition.SCORING`) that judged them last; a later one may
    be asked to prove it again. reproduced: another process, maybe with other code or on another machine, found the same
    (None = not tried).
    Of a pair, in both its rows, None without a pair: exclusive: neither half's certified commands pass in the other
    half. passed_by: a driver that passes both halves without plates, "" = none that was tried. blind_equal: the
    first view of the halves is the same bytes but for what the plates say. differs_s: time from which on others do
    something else than in the other half, None where they never do before the ego is past its line. brake_mps2: the
    deceleration that would still stop the ego before that line then, None likewise.
    """

    scenario_id: str
    scenario_type: str
    split: str
    attempt: int
    expert: str
    expert_time_s: float
    blind_baseline: str
    blind_outcome: str
    tempting: bool
    engaged: bool
    asked_density: float
    realised_density: float
    road_users: int
    overlaps: int
    arrival_gap_s: float
    error: str
    digest: str
    basis: str
    scoring: int
    reproduced: bool | None
    exclusive: bool | None = None
    passed_by: str | None = None
    blind_equal: bool | None = None
    differs_s: float | None = None
    brake_mps2: float | None = None

    def beside(
        self, exclusive: bool, passed_by: str, blind_equal: bool, differs_s: float | None, brake_mps2: float | None
    ) -> Certificate:
        """It with what its row and another show, beside what a third one has shown: of each the worse."""
        if self.exclusive is not None:
            exclusive, blind_equal = exclusive and self.exclusive, blind_equal and bool(self.blind_equal)
            passed_by = self.passed_by or passed_by
            if brake_mps2 is None or (self.brake_mps2 is not None and self.brake_mps2 < brake_mps2):
                differs_s, brake_mps2 = self.differs_s, self.brake_mps2
        return replace(
            self,
            exclusive=exclusive,
            passed_by=passed_by,
            blind_equal=blind_equal,
            differs_s=differs_s,
            brake_mps2=brake_mps2,
        )

    def unpaired_because(self, row: ScenarioSpec) -> str:
        """Why the row's pair measures nothing; "" if it does, was not looked at, or does not exist."""
        if row.pair_id and row.scenario_id == row.pair_name and not (self.engaged and self.tempting):
            return (
                f"{self.blind_baseline} keeps the rule of the signed half" if self.engaged else "the rule binds nobody"
            )
        if self.exclusive is False:
            return "one drive passes both halves"
        if self.passed_by:
            return f"{self.passed_by} passes both halves"
        if self.blind_equal is False:
            return "the halves differ in more than what the plates say"
        if self.brake_mps2 is not None and self.brake_mps2 < LATE_BRAKE_MPS2:
            return f"who watches the others can still stop with {self.brake_mps2:.1f} m/s2"
        return ""

    @property
    def solvable(self) -> bool:
        """Some expert got SCD."""
        return bool(self.expert)

    def differences(self, other: Certificate) -> list[str]:
        """In what two proofs of one row differ, as "WHAT was A, is B".

        The digests may: they hold every bit of every pose, and the last bits are the processor's and its libraries'.
        """
        return [
            f"{name} was {old!r}, is {new!r}"
            for name in _PROVEN
            if not _same(old := getattr(self, name), new := getattr(other, name))
        ]

    @property
    def sane(self) -> bool:
        """Traffic is there as asked, no bodies overlap, and both episodes came to an end."""
        if self.error or self.overlaps:
            return False
        if not self.asked_density:
            return True
        close = abs(self.realised_density / self.asked_density - 1.0) <= DENSITY_TOLERANCE
        return close and self.road_users > 0


_OF_PAIRS = ("exclusive", "passed_by", "blind_equal", "differs_s", "brake_mps2")
_PROVEN = (
    "expert", "expert_time_s", "blind_baseline", "blind_outcome", "tempting", "engaged", "road_users", "overlaps",
    "arrival_gap_s", "error", *_OF_PAIRS,
)  # fmt: skip


def _same(old: object, new: object) -> bool:
    if isinstance(old, float) and isinstance(new, float):
        return (math.isnan(old) and math.isnan(new)) or abs(old - new) < _TIME_TOLERANCE_S
    return old == new


SCHEMA = pa.schema(fields_of(Certificate)).with_metadata({VERSION_KEY: str(SCHEMA_VERSION), **OSM_LICENCE})


def certificates_path(root: Path) -> Path:
    return root / "certificates.parquet"


def write_certificates(certificates: Iterable[Certificate], path: Path) -> None:
    """Write them sorted by scenario id: the same certificates give the same bytes."""
    save_rows(certificates, path, SCHEMA)


def read_certificates(path: Path) -> list[Certificate]:
    """All certificates, sorted by scenario id. Raises InputError for a missing, broken or foreign file."""
    return read_rows(Certificate, path, SCHEMA, "tsbench scenarios build makes it", _OF_PAIRS)


def certificates_of(data: DataSet) -> list[Certificate]:
    """Those of a data set; of a mirrored one those of the stored rows, by the names of their images."""
    rows = read_certificates(data.certificates_path)
    if data.image is None:
        return rows
    renamed = [replace(row, scenario_id=mirrored_id(row.scenario_id, data.image)) for row in rows]
    return sorted(renamed, key=lambda row: row.scenario_id)


def bases(rows: Sequence[ScenarioSpec]) -> dict[str, str]:
    """What a certificate of each row is about, by scenario id: 16 hex digits over the row and SUMO's version.

    Not its place: that is a matter of the maps beside it in the table.
    """
    sumo = versions(["libsumo"])
    return {row.scenario_id: digest([data_hash([replace(row, place="")], ()), sumo])[:16] for row in rows}
