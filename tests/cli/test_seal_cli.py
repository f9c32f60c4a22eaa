"""`tsbench seal` end to end: a secret, scenes that are drawn with it, commitments, and what is found later."""

from __future__ import annotations

import json
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from town_clone import call, town_clone

from tsbench.make.seeds import SECRET, rng_of, root_sequence, seed_of, using_secret

pytestmark = pytest.mark.slow
WITH = ("--types", "yield", "--workers", "1")


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with town_clone(tmp_path_factory.mktemp("clone")) as root:
        yield root


def rows_of(data: Path) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = pq.read_table(data / "scenarios" / "dev.parquet").to_pylist()
    return rows


def test_sealed_scenes_are_committed_to_run_and_checked(
    clone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, keys = clone / "cities" / "data" / "nowhere", [tmp_path / name for name in ("mine", "another")]
    for key in keys:
        call(capsys, "seal", "secret", str(key))
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert "File exists" in call(capsys, "seal", "secret", str(keys[0]), code=2)

    def built(key: Path, code: int = 0) -> str:
        return call(
            capsys, "seal", "build", "nowhere", "--secret", str(key), "--osm", str(clone / "osm"), *WITH, code=code
        )

    assert "tsbench seal commit nowhere" in built(keys[0])
    mine = rows_of(data)
    assert "begun with another secret" in built(keys[1], code=2)
    assert "0 problems" in call(capsys, "scenarios", "verify", "--city", "nowhere")
    asked = ("--planner", "idm", "--limit", "2", "--workers", "1", "--out", str(tmp_path / "run"))
    assert "nowhere-" in call(capsys, "run", "--city", "nowhere", "--split", "dev", *asked)

    published = tmp_path / "commitments.json"
    call(capsys, "seal", "commit", "nowhere", "--out", str(published))
    told = published.read_text(encoding="utf-8")
    assert keys[0].read_text(encoding="utf-8").strip() not in told
    assert json.loads(told)["rows"]["dev"]["yield"] == len(mine)
    # What is published leads to no scene: no id, no seed, no map.
    assert not any(str(row[key]) in told for row in mine for key in ("scenario_id", "map_id", "seed"))
    check = ("seal", "check", str(published), "--secret")
    assert "and the secret" in call(capsys, *check, str(keys[0]))
    assert "is not the secret that was committed to" in call(capsys, *check, str(keys[1]), code=1)

    store = data / "scenarios" / "scenes" / "dev" / "yield.parquet"
    kept = store.read_bytes()
    store.write_bytes(kept[:-1] + b"x")
    (data / "scenarios" / "more.parquet").write_bytes(kept)
    found = call(capsys, *check, str(keys[0]), code=1)
    assert "scenarios/scenes/dev/yield.parquet: has SHA-256" in found
    assert "scenarios/more.parquet: is here and was not committed to" in found
    store.unlink()
    assert "yield.parquet: was committed to and is not here" in call(capsys, *check, str(keys[0]), code=1)

    # Whoever has the secret makes the same files again; without it, or with another, come other scenes.
    shutil.rmtree(data)
    built(keys[0])
    assert "all " in call(capsys, *check, str(keys[0]))
    for key in (keys[1], None):
        shutil.rmtree(data)
        if key is None:
            call(capsys, "city", "build", "nowhere", "--osm", str(clone / "osm"), *WITH)
            assert "was built without a secret" in built(keys[0], code=2)
            assert "is not sealed" in call(capsys, "seal", "commit", "nowhere", "--out", str(published), code=2)
        else:
            built(key)
        other = rows_of(data)
        assert {row["seed"] for row in other}.isdisjoint(row["seed"] for row in mine)


def test_draws_are_the_public_ones_but_with_a_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tsbench.core import seeds

    monkeypatch.delenv(SECRET, raising=False)
    assert seed_of("a", 1) == seeds.seed_of("a", 1)
    assert rng_of("a").random() == seeds.rng_of("a").random()
    assert root_sequence(7).entropy == [seeds.ROOT_SEED, 7]
    key = tmp_path / "key"
    key.write_text("0" * 63 + "1\n", encoding="utf-8")
    with using_secret(key):
        assert seed_of("a", 1) != seeds.seed_of("a", 1)
        assert root_sequence(7).entropy == [seeds.ROOT_SEED, 7, 1]
    assert seed_of("a", 1) == seeds.seed_of("a", 1)


def test_what_is_no_secret_or_no_commitment_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = tmp_path / "file"
    wrong.write_text("{}", encoding="utf-8")
    asked = ("seal", "build", "krems", "--secret", str(wrong))
    assert "is no secret" in call(capsys, *asked, code=2)
    assert f"{wrong}: schema: is missing" in call(capsys, "seal", "check", str(wrong), code=2)
