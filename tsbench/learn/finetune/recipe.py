"""What a training of `plant2-ft` is asked to be, and which drives it learns from."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.seeds import rng_of
from tsbench.episode.perception_level import Perception, PerceptionLevel
from tsbench.learn.finetune.obedient_frames import FinetuneSource, RecordedDrive, TakeoverDrive
from tsbench.learn.finetune.targets import FinetuneSampling
from tsbench.learn.imitation.frames import EpisodeDrive
from tsbench.learn.imitation.recipe import TrainingRecipe, driven_in_turn, in_turn, kept_for_validation
from tsbench.learn.oracle.trajectories import stream_trajectories
from tsbench.learn.plant2.layout import size_of
from tsbench.learn.plant2.planner_ft import Plant2Blind, Plant2Ft
from tsbench.learn.plant2.sign_tokens import Vocabulary, vocabulary_of, vocabulary_of_catalog
from tsbench.planners.weights import Network, network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

# Takeovers are drawn from this many ticks on, up to so many: from the start to a little behind most signs' lines.
_TAKEOVER_TICKS = (5, 120)
_PART = "train"


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
        if recorded.scenario_id in known and recorded.part == _PART and recorded.rank:
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
