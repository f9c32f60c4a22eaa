"""What a training by imitation is asked to be, the rows that it learns from and is chosen by, and closed-loop skill."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from tsbench.core.errors import InputError, SimulationError
from tsbench.core.machine import one_thread_each
from tsbench.core.parallel import worker_processes
from tsbench.core.seeds import rng_of, seed_of
from tsbench.episode.outcome import Outcome
from tsbench.episode.perception_level import Perception, PerceptionLevel
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.imitation.frames import PlannerDrive, Sampling
from tsbench.learn.imitation.targets import EpisodeDrive, FinetuneSampling, FinetuneSource, RecordedDrive, TakeoverDrive
from tsbench.learn.oracle.trajectories import stream_trajectories
from tsbench.learn.plant2.plant2_planner import Plant2, Plant2Blind, Plant2Ft, StopPolicy
from tsbench.learn.plant2.sign_tokens import Vocabulary, vocabulary_of, vocabulary_of_catalog
from tsbench.learn.plant2.tokens import size_of
from tsbench.planners.registry import LoadedPlanner
from tsbench.planners.weights import Network, network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

# Of the train maps, one in so many is kept for the choice of checkpoints.
_VALIDATION_SHARE = 12
# Drives of a type that is asked for more of, in each turn.
_MORE = 3
# Takeovers are drawn from this many ticks on, up to so many: from the start to a little behind most signs' lines.
_TAKEOVER_TICKS = (5, 120)
# Whose weights can be measured, by name.
MEASURED: Mapping[str, type[Plant2]] = {kind.weights: kind for kind in (Plant2, Plant2Ft, Plant2Blind)}


@dataclass(frozen=True, kw_only=True)
class TrainingRecipe:
    """Figures of every training by imitation.

    epochs: passes over the frames. batch, rate, decay, clip, warm_up: AdamW's batch size, top learning rate (falls by a
    cosine), weight decay, greatest norm of a gradient, share of the training in which the rate rises. validation:
    episodes driven after each epoch. drivers: planners that are driven for frames, in turn. types: () = all.
    """

    epochs: int
    batch: int
    rate: float
    validation: int
    drivers: tuple[str, ...] = ()
    decay: float = 0.05
    clip: float = 1.0
    warm_up: float = 0.02
    types: tuple[str, ...] = ()
    seed: int = 0
    sampling: Sampling = field(default_factory=Sampling)

    def facts(self) -> dict[str, Any]:
        """What a training that is continued must have in common with the one before, for JSON."""
        found = {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self).items()}
        return {**found, "split": "train"}


@dataclass(frozen=True, kw_only=True)
class ImitationRecipe(TrainingRecipe):
    """`plant2`'s. size: a name of `tokens.SIZES`; episodes: drives to learn from, in turn over types and drivers."""

    size: str = "mini"
    episodes: int = 4000
    epochs: int = 12
    drivers: tuple[str, ...] = ("idm",)
    batch: int = 256
    rate: float = 6e-4
    validation: int = 160


def kept_for_validation(spec: ScenarioSpec) -> bool:
    """Is the row's map one of those that checkpoints are chosen on?"""
    return seed_of("imitation", "validation", spec.map_id) % _VALIDATION_SHARE == 0


def drives_of(rows: Sequence[ScenarioSpec], recipe: ImitationRecipe) -> list[PlannerDrive]:
    """The drives to learn from: types in turn, drawn pairs of each, drivers in turn."""
    chosen = in_turn([r for r in rows if not kept_for_validation(r)], recipe.episodes, recipe.seed, "drives")
    return driven_in_turn(chosen, recipe.drivers)


def driven_in_turn(rows: Sequence[ScenarioSpec], drivers: Sequence[str]) -> list[PlannerDrive]:
    """Drivers in turn over the pairs: the driver must not tell one half from the other."""
    turn = {name: k for k, name in enumerate(dict.fromkeys(row.pair_name for row in rows))}
    return [PlannerDrive(row, drivers[turn[row.pair_name] % len(drivers)]) for row in rows]


def validation_rows(rows: Sequence[ScenarioSpec], count: int, seed: int) -> list[ScenarioSpec]:
    return in_turn([r for r in rows if kept_for_validation(r)], count, seed, "validation")


def in_turn(
    rows: Sequence[ScenarioSpec], count: int, seed: int, what: str, more: Collection[str] = ()
) -> list[ScenarioSpec]:
    """`count` rows: a pair drawn of each type (of those in `more`: three), again until there are enough or no more.

    Both halves follow each other and count as of the signed one's type, whatever the other's plate is; only the last
    pair may be cut. A row that has no other half stands for itself.
    """
    by_type: dict[str, dict[str, list[ScenarioSpec]]] = {}
    for row in sorted(rows, key=lambda r: r.scenario_id):
        by_type.setdefault(row.pair_type, {}).setdefault(row.pair_name, []).append(row)
    shuffled: list[tuple[list[list[ScenarioSpec]], int]] = []
    for name, pairs in sorted(by_type.items()):
        of_type = list(pairs.values())
        order = rng_of("imitation", what, seed, name).permutation(len(of_type))
        shuffled.append(([of_type[i] for i in order], _MORE if name in more else 1))
    longest = max((len(of_type) for of_type, _ in shuffled), default=0)
    turns = [
        row
        for k in range(longest)
        for of_type, each in shuffled
        for pair in of_type[k * each : (k + 1) * each]
        for row in pair
    ]
    return turns[:count]


@dataclass(frozen=True, kw_only=True)
class FineTuning(TrainingRecipe):
    """Figures of a fine-tuning; the defaults are docs/finetuning.md's.

    mask_signs: are posts shown in place of plates? Then the network is `plant2-blind`'s, here and wherever weights of
    `plant2-ft` are asked for below.
    perception: the level of the eyes through which a share `perceived` (0 to 1) of the drives is seen; None: exact.
    base: folder of `plant2`'s weights, or of `plant2-ft`'s, which are trained on; None = tsbench's own `plant2`.
    drivers: none = the oracle's drives in `trajectories`. drives: how many, types in turn, three a turn of those in
    `more`; 0 = all. student: folder of `plant2-ft`'s weights that begin `takeover` (0 to 1) of the drives, which
    `expert` ends. layer_decay: of the rate, per layer from the heads down; new_factor: of the rate, for new parameters.
    cap: greatest share of a family in a batch.
    """

    mask_signs: bool = False
    perception: PerceptionLevel | None = None
    perceived: float = 0.3
    base: Path | None = None
    trajectories: Path | None = None
    drives: int = 0
    more: tuple[str, ...] = ()
    student: Path | None = None
    takeover: float = 0.3
    expert: str = "idm-e"
    epochs: int = 26
    batch: int = 128
    rate: float = 1e-4
    layer_decay: float = 0.8
    new_factor: float = 5.0
    cap: float = 0.25
    validation: int = 58
    sampling: FinetuneSampling = field(default_factory=FinetuneSampling)

    @property
    def planner(self) -> type[Plant2Ft]:
        """Whose network is trained."""
        return Plant2Blind if self.mask_signs else Plant2Ft

    @property
    def name(self) -> str:
        """Of what is trained, as its weights are called."""
        return self.planner.weights

    @property
    def starts_tuned(self) -> bool:
        """Is it a network of this name that is trained on, with the words that it has?"""
        return self.base is not None and (self.base / f"{self.name}.json").is_file()

    def begins_with(self) -> Network:
        """The weights that the training begins with. Raises InputError where there are none."""
        return network(self.name if self.starts_tuned else "plant2", self.base)

    def vocabulary(self) -> Vocabulary:
        """The base's words, where it has some; else all signs of the catalogue, and posts where they are masked."""
        if self.starts_tuned:
            return vocabulary_of(self.base, self.name)
        words = vocabulary_of_catalog(DataSet().catalog)
        return words.with_posts() if self.mask_signs else words

    def source(self) -> FinetuneSource:
        """What makes frames of the drives."""
        perceived = 0.0 if self.perception is None else self.perceived
        seen = Perception(self.mask_signs, self.perception)
        return FinetuneSource(self.sampling, self.vocabulary(), seen, perceived)

    def facts(self) -> dict[str, Any]:
        """What a training that is continued must have in common with the one before: files by their hashes."""
        base, found = self.begins_with(), super().facts()
        found |= {"base": base.weights.sha256, "student": None, "trajectories": None}
        if self.student is not None:
            found["student"] = network(self.name, self.student).weights.sha256
        if self.trajectories is not None and not self.drivers:
            found["trajectories"] = hashlib.sha256(self.trajectories.read_bytes()).hexdigest()
        return {"size": size_of(base), **found}


def finetune_drives(rows: Sequence[ScenarioSpec], recipe: FineTuning) -> list[EpisodeDrive]:
    """The drives to learn from, types in turn; of no map that checkpoints are chosen on.

    Raises InputError for recorded drives of scenarios that the train split has not.
    """
    drives = _driven(rows, recipe) if recipe.drivers else _recorded(rows, recipe)
    if recipe.student is None:
        return drives
    student, sha256 = recipe.student, network(recipe.name, recipe.student).weights.sha256
    made: list[EpisodeDrive] = []
    for drive in drives:
        # By what the drive is, not by its place in a list in which types come in turn.
        rng = rng_of("takeover", recipe.seed, sha256, *drive.names)
        share, tick = float(rng.random()), int(rng.integers(*_TAKEOVER_TICKS))
        taken = TakeoverDrive(drive.spec, recipe.expert, tick, student, sha256, recipe.planner)
        made.append(taken if share < recipe.takeover else drive)
    return made


def _driven(rows: Sequence[ScenarioSpec], recipe: FineTuning) -> list[EpisodeDrive]:
    chosen = [row for row in rows if not kept_for_validation(row)]
    chosen = in_turn(chosen, recipe.drives or len(chosen), recipe.seed, "lessons", recipe.more)
    return list(driven_in_turn(chosen, recipe.drivers))


def _recorded(rows: Sequence[ScenarioSpec], recipe: FineTuning) -> list[EpisodeDrive]:
    assert recipe.trajectories is not None
    known = {row.scenario_id: row for row in rows}
    # Places in the table first: only the drives that are asked for are kept.
    by_scenario: dict[str, list[int]] = {}
    for place, recorded in enumerate(stream_trajectories(recipe.trajectories)):
        if recorded.scenario_id in known and recorded.part == "train" and recorded.rank:
            by_scenario.setdefault(recorded.scenario_id, []).append(place)
    chosen = [row for row in rows if row.scenario_id in by_scenario and not kept_for_validation(row)]
    if not chosen:
        raise InputError(f"{recipe.trajectories}: no drives of the train split's scenarios of these types")
    order = in_turn(chosen, len(chosen), recipe.seed, "lessons", recipe.more)
    # The best drive of each scenario first, then the second best ones.
    tries = [(k, row.scenario_id) for k in range(max(map(len, by_scenario.values()))) for row in order]
    places = [by_scenario[name][k] for k, name in tries if k < len(by_scenario[name])]
    places = places[: recipe.drives or len(places)]
    wanted = set(places)
    found = {
        place: RecordedDrive(known[recorded.scenario_id], recorded)
        for place, recorded in enumerate(stream_trajectories(recipe.trajectories))
        if place in wanted
    }
    return [found[place] for place in places]


class End(NamedTuple):
    """Of an episode: its outcome, whether the sign was obeyed (`EpisodeFacts.obeyed`), its error."""

    outcome: Outcome
    obeyed: bool
    error: str


@dataclass(frozen=True, slots=True)
class Skill:
    """Shares of episodes: arrived, with a contact, off the road, out of time, arrived and compliant; compliant."""

    episodes: int
    arrived: float
    collision: float
    off_road: float
    timeout: float
    scd: float
    compliant: float


def measure(planner: str, folder: Path, rows: Sequence[ScenarioSpec], workers: int) -> Skill:
    """Drive the weights of a planner of MEASURED below `folder` through `rows`; raises as `drive` and `skill_of`."""
    return skill_of(drive(planner, folder, rows, workers))


def drive(
    planner: str, folder: Path | None, rows: Sequence[ScenarioSpec], workers: int, stop_policy: StopPolicy | None = None
) -> list[End]:
    """How the episodes of `rows` end, in their order. folder: None = tsbench's own weights. patience: of `plant2-ft`,
    None = its own.
    """
    shares = [list(rows[k::workers]) for k in range(workers)]
    with one_thread_each(), worker_processes(workers, "measuring a planner") as pool:
        parts = list(pool.ordered(_drive, [(planner, folder, stop_policy, share) for share in shares]))
    return [parts[k % workers][k // workers] for k in range(len(rows))]


def skill_of(ends: Sequence[End]) -> Skill:
    """Shares of some episodes.

    Raises SimulationError where an episode ended in an error: no skill is averaged over a hole.
    """
    broken = [end.error for end in ends if end.error]
    if broken:
        raise SimulationError(f"validation: {len(broken)} episodes broke off, the first by: {broken[0]}")
    count = max(len(ends), 1)
    ways = (Outcome.ARRIVED, Outcome.COLLISION, Outcome.OFF_ROAD, Outcome.TIMEOUT)
    share = {str(way): sum(end.outcome == way for end in ends) / count for way in ways}
    scd = sum(end.outcome is Outcome.ARRIVED and end.obeyed for end in ends) / count
    return Skill(episodes=len(ends), scd=scd, compliant=sum(end.obeyed for end in ends) / count, **share)


def _drive(planner: str, folder: Path | None, stop_policy: StopPolicy | None, rows: list[ScenarioSpec]) -> list[End]:
    import torch

    torch.set_num_threads(1)
    kind = MEASURED[planner]
    make = partial(kind, stop_policy=stop_policy) if issubclass(kind, Plant2Ft) else kind
    runner = EpisodeRunner(LoadedPlanner(planner, partial(make, folder=folder)))
    ends = []
    for row in rows:
        result = runner.run(row)
        obeyed = result.facts is not None and not result.facts.verdicts.against
        ends.append(End(result.outcome, obeyed, result.error if result.outcome.is_error else ""))
    runner.close()
    return ends
