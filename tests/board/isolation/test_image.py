"""Planners in containers: the command that is built, what is refused, and episodes through an engine."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import fake_engine
import pytest
from command_line import in_process, refused

import tsbench
from tsbench.board.claim import claims_of
from tsbench.board.isolation import image
from tsbench.board.isolation.image import find_engine, run_arguments
from tsbench.board.isolation.isolated_loading import describe
from tsbench.board.isolation.sandbox_contents import PlannerFiles
from tsbench.board.verification import verify
from tsbench.core.errors import InputError
from tsbench.run.log.journal import read_table

ROOT = Path(tsbench.__file__).parent.parent
MINE = f"{ROOT}/examples/minimal_planner.py:Minimal"
Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Makes engines the only ones on PATH; each has a folder of its own."""

    def made(*names: str) -> Path:
        folders = [tmp_path / f"engine-{name}" for name in names]
        for name, folder in zip(names, folders, strict=True):
            folder.mkdir()
            code = Path(fake_engine.__file__).read_text(encoding="utf-8")
            (folder / name).write_text(f"#!{sys.executable}\n{code}", encoding="utf-8")
            (folder / name).chmod(0o755)
        monkeypatch.setenv("PATH", os.pathsep.join(map(str, folders)) or str(tmp_path / "nothing"))
        return folders[0] if folders else tmp_path

    return made


def calls(engine: Path) -> list[list[str]]:
    return [json.loads(line) for line in (engine / "calls").read_text().splitlines()]


def test_the_command_gives_a_container_nothing_but_the_line_and_the_planners_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TSBENCH_TEST_SECRET", "1")
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
    command = ["python3", "-m", "client", MINE]
    own = PlannerFiles(MINE)
    told = run_arguments("docker", "planner:1", "tsbench-sandbox-1", tmp_path, MINE, command, own.binds)
    at = told.index("planner:1")
    assert told[at - 1 :] == ["--entrypoint=python3", "planner:1", "-m", "client", MINE]
    options = told[:at]
    assert options[0] == "run"
    for needed in (
        "--rm", "--pull=never", "--network=none", "--read-only", "--cap-drop=ALL", "--pids-limit=256",
        "--security-opt=no-new-privileges", "--memory=4294967296", "--memory-swap=4294967296", "--ulimit=nofile=256",
        "--ulimit=cpu=21600", "--log-driver=none",
    ):  # fmt: skip
        assert needed in options
    assert [one for one in options if one.startswith("--mount")] == [
        f"--mount=type=bind,source={tmp_path}/line,target=/tsbench-line,readonly",
        f"--mount=type=bind,source={own.binds[0][0]},target={ROOT}/examples,readonly",
    ]
    assert (own.binds[0][0] / "minimal_planner.py").is_file()
    assert "--env=TSBENCH_LINE=/tsbench-line/socket" in options
    assert "--env=OPENBLAS_CORETYPE=Haswell" in options
    assert not [one for one in options if "SECRET" in one or ("privileged" in one.lower() and "no-new" not in one)]


def test_nobody_runs_it_for_root_and_the_user_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    for uid, engine, user, keeps in (
        (0, "docker", "65534:65534", False),
        (1000, "docker", "1000:1000", False),
        (1000, "podman", "1000:1000", True),
    ):
        for name in ("getuid", "geteuid", "getgid"):
            monkeypatch.setattr(os, name, lambda uid=uid: uid)
        told = run_arguments(engine, "i", "n", Path("/x"), "idm", ["python3"], PlannerFiles("idm").binds)
        assert f"--user={user}" in told
        assert ("--userns=keep-id" in told) is keeps
        assert len([one for one in told if one.startswith("--mount")]) == 1, "tsbench itself is in the image"


def test_a_module_beside_the_run_is_mounted_and_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "bots"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "one.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    own = PlannerFiles("bots.one:One")
    told = run_arguments("docker", "i", "n", Path("/x"), "bots.one:One", ["python3"], own.binds)
    assert f"--mount=type=bind,source={own.binds[0][0]},target={package},readonly" in told
    assert f"--env=PYTHONPATH={tmp_path}" in told


def test_a_path_that_cannot_be_mounted_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no path with a comma"):
        run_arguments("docker", "i", "n", tmp_path, "idm", ["python3"], [(tmp_path, tmp_path / "a,b")])


def test_an_engine_is_found_or_missed_in_words(install: Install, tmp_path: Path) -> None:
    install()
    with pytest.raises(InputError, match="--image: neither docker nor podman is on PATH"):
        find_engine()
    docker = install("docker", "podman")
    assert find_engine() == "docker"
    (docker / "down").touch()
    assert find_engine() == "podman"
    (tmp_path / "engine-podman" / "down").touch()
    with pytest.raises(InputError, match=r"docker does not answer \(Cannot connect to the Docker daemon.*podman"):
        find_engine()


def test_an_image_that_is_not_here_and_one_without_tsbench(install: Install) -> None:
    install("docker")
    with pytest.raises(InputError, match=r"--image other:2: docker has no such image here .*docker pull other:2"):
        describe("image:other:2 idm")
    with pytest.raises(InputError, match="the container ended with exit code 1 before its planner connected"):
        describe("image:broken:1 idm")


def test_an_image_goes_with_isolation(install: Install, capsys: pytest.CaptureFixture[str]) -> None:
    install("docker")
    run, planners = in_process("run", capsys), in_process("planners", capsys)
    assert "add --isolate" in refused(run, "--planner", "idm", "--split", "dev", "--image", "planner:1")
    assert "add --submission" in refused(planners, "check", "idm", "--image", "planner:1")


@pytest.mark.slow
def test_an_image_drives_as_a_sandbox_does_and_is_verified_in_it(install: Install, tmp_path: Path) -> None:
    told = {"split": "dev", "types": ["crosswalk"], "limit": 2, "workers": 1, "isolate": True}
    tsbench.evaluate(MINE, **told, out=tmp_path / "sandbox")  # type: ignore[arg-type]
    engine = install("docker")
    tsbench.evaluate(MINE, **told, out=tmp_path / "image", image="planner:1")  # type: ignore[arg-type]
    (sandbox,), (inside,) = claims_of(tmp_path / "sandbox"), claims_of(tmp_path / "image")
    assert inside.episodes == sandbox.episodes
    assert inside.planner.spec == f"image:planner:1 {MINE}"
    assert inside.planner.code_sha256 == sandbox.planner.code_sha256
    effects = json.loads((tmp_path / "image" / "run.json").read_text())["isolation"]["Minimal"]
    assert (effects["namespaces"], effects["image"], effects["image_id"]) == ("docker", "planner:1", "ab" * 32)
    found = verify(inside, None, sample=1, seed=1, verifier="", workers=1, on_progress=lambda *_: None)
    assert (found.good, found.equal) == (True, 1)
    ran = [one for one in calls(engine) if one[0] == "run"]
    assert len(ran) >= 4, "described and driven, twice"
    assert not list(engine.glob("*.pid")), "each container was removed"


@pytest.fixture
def program(tmp_path: Path) -> str:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) here")
    binary, source = tmp_path / "follow_route", ROOT / "examples" / "follow_route.c"
    # Static: an image may be empty.
    made = subprocess.run(["cc", "-O2", "-static", "-o", str(binary), str(source), "-lm"], check=False)
    if made.returncode:
        pytest.skip("cc links nothing statically here")
    return f"exe:{binary}"


def outcomes(folder: Path) -> list[str]:
    return [row["outcome"] for row in read_table(folder / "episodes.parquet").to_pylist()]


def test_a_program_connects_from_its_container(program: str, install: Install, tmp_path: Path) -> None:
    install("docker")
    tsbench.evaluate(program, split="dev", limit=2, workers=1, isolate=True, image="planner:1", out=tmp_path / "run")
    assert outcomes(tmp_path / "run").count("arrived") >= 1


def test_containers_of_workers_that_were_killed_are_removed(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = install("docker")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "tsbench-sandbox-lives").mkdir()
    (engine / "left").write_text(
        f"gone {tmp_path}/tsbench-sandbox-gone\nlives {tmp_path}/tsbench-sandbox-lives\n"
        "others /elsewhere/tsbench-sandbox-x\n"
    )
    image.remove_abandoned("docker")
    assert [one for one in calls(engine) if one[0] == "rm"] == [["rm", "--force", "gone"]]


def test_an_engine_that_is_there_runs_a_program_in_an_empty_image(program: str, tmp_path: Path) -> None:
    try:
        engine = find_engine()
    except InputError as missing:
        pytest.skip(str(missing))
    name = "tsbench-test-empty"
    subprocess.run([engine, "build", "--tag", name, "-"], input=b"FROM scratch\nLABEL of=tsbench\n", check=True)
    try:
        for out, within in (("sandbox", None), ("image", name)):
            tsbench.evaluate(program, split="dev", limit=2, workers=1, isolate=True, image=within, out=tmp_path / out)
        (sandbox,), (inside,) = claims_of(tmp_path / "sandbox"), claims_of(tmp_path / "image")
        assert inside.episodes == sandbox.episodes
        left = subprocess.run(
            [engine, "ps", "--all", "--quiet", "--filter", f"ancestor={name}"], capture_output=True, check=True
        )
        assert not left.stdout.strip()
    finally:
        subprocess.run([engine, "rmi", "--force", name], check=True)
