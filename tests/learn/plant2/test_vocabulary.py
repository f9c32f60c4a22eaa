"""A network's vocabulary of signs is data of its weights: the catalogue may grow without changing what it sees."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from learned_scenes import record, with_signs

from tsbench.core.errors import InputError
from tsbench.core.paths import data_root
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.planner_ft import RouteAlternatives, SignTokeniser
from tsbench.learn.plant2.sign_tokens import READER, vocabulary_of, vocabulary_of_catalog
from tsbench.learn.plant2.tokens import Tokeniser
from tsbench.planners.weights import load_weights, save_weights
from tsbench.signs.catalog import load_catalog

_NEW = "3.99"
_RUN = "import sys; from tsbench.cli import main; sys.exit(main())"


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with one sign more."""
    root: Path = tmp_path_factory.mktemp("data")
    for path in data_root().iterdir():
        if path.name in ("scenarios", "sumo_nets"):
            (root / path.name).symlink_to(path)
    catalog = Path(shutil.copytree(data_root() / "sign_catalog", root / "sign_catalog"))
    text = (catalog / "signs" / "4.6.yaml").read_text(encoding="utf-8")
    for old, new in (("id: min_speed", "id: another"), ("row: 8", "row: 99"), ('"4.6"', f'"{_NEW}"')):
        assert old in text
        text = text.replace(old, new)
    (catalog / "signs" / f"{_NEW}.yaml").write_text(text, encoding="utf-8")
    assert _NEW in load_catalog(catalog).signs
    return root


def test_a_new_sign_is_unknown_and_changes_no_token() -> None:
    drive, words = record(), vocabulary_of()

    def tokens(new: bool) -> list[bytes]:
        ways = RouteAlternatives(drive.context.graph, drive.context.destination)
        tokeniser = SignTokeniser(Tokeniser(drive.context.network), ways, words)
        found = []
        for o in map(with_signs, drive.seen):
            plate = replace(o.signs[-1], code=_NEW, value=40.0)
            seen = replace(o, signs=(*o.signs[:1], plate, *o.signs[1:])) if new else o
            frame = np.zeros(1, dtype=at.SIGN_TOKENS)
            tokeniser.watch(seen)
            tokeniser.fill(frame[0], seen)
            found.append(frame.tobytes())
        return found

    assert tokens(new=True) == tokens(new=False)
    assert tokens(new=False) != [tokens(new=False)[0]] * len(drive.seen)


@pytest.mark.slow
def test_it_drives_as_before_with_a_larger_catalogue(grown: Path, tmp_path: Path) -> None:
    def drives(data: Path, out: Path) -> list[dict[str, object]]:
        asked = ["--planner", READER, "--split", "test", "--types", "stop,speed_limit", "--limit", "2"]
        subprocess.run(
            [sys.executable, "-c", _RUN, "run", *asked, "--workers", "1", "--trace", "none", "--out", str(out)],
            env={**os.environ, "TSBENCH_DATA": str(data)}, check=True, capture_output=True,
        )  # fmt: skip
        rows: list[dict[str, object]] = pq.read_table(out / "episodes.parquet").to_pylist()
        return rows

    before, after = drives(data_root(), tmp_path / "before"), drives(grown, tmp_path / "after")
    assert len(after) == 2
    assert after == before


def test_a_new_training_learns_what_the_catalogue_has_beyond(grown: Path) -> None:
    old = vocabulary_of()
    assert vocabulary_of_catalog(load_catalog()) == old
    new = vocabulary_of_catalog(load_catalog(grown / "sign_catalog"))
    assert set(new.codes) == {*old.codes, _NEW}
    assert replace(new, codes=old.codes) == old


def test_weights_without_a_vocabulary_are_refused(tmp_path: Path) -> None:
    save_weights(READER, tmp_path, load_weights(READER), {"size": "mini"})
    with pytest.raises(InputError, match="no vocabulary of signs"):
        vocabulary_of(tmp_path)
