"""The reference bytes under other arithmetics than this machine's own, and who may go on under another one."""

from __future__ import annotations

import copy
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsbench.cli import network_arithmetic as doctor
from tsbench.cli.diagnosis import Status
from tsbench.run import arithmetic
from tsbench.run.log.manifest import difference, new_manifest
from tsbench.run.planner_info import PlannerInfo

SIMD = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
# What other processors choose: everything at once, as an older and as a newer one does. OpenCV warns of what it does
# not know.
SETTINGS = {
    "this one": {},
    "SSE": {
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": " ".join(SIMD),
        "OPENCV_CPU_DISABLE": "AVX512-SKX,AVX2,FMA3,AVX,SSE4.2,SSE4.1",
        "ATEN_CPU_CAPABILITY": "default",
        "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
    },
    "AVX2": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in SIMD if name != "X86_V3"),
        "OPENCV_CPU_DISABLE": "AVX512-SKX",
    },
    "AVX-512": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
NEEDS = {"AVX2": "X86_V3", "AVX-512": "X86_V4"}
_NO_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"}
_FACTS = "import json; from tsbench.run.arithmetic import facts; print(json.dumps(facts()['answers']))"
_NETWORKS = """
import json
from tsbench.run.arithmetic import facts
from tsbench.cli.network_arithmetic import NETWORKS, answers_hash
print(json.dumps([{name: answers_hash(name) for name in NETWORKS}, facts()["answers"]]))
"""


def under(settings: dict[str, str], code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **settings}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def reference() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path(doctor.__file__).with_name("arithmetic.json").read_text())
    return found


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", SETTINGS)
def test_every_planner_gives_the_reference_bytes(name: str) -> None:
    if NEEDS.get(name, "X86_V2") not in ["X86_V2", *SIMD]:
        pytest.skip(f"this processor has no {NEEDS[name]}")
    said = under(SETTINGS[name], "from tsbench.cli import main; main(['doctor', '--arithmetic'])")
    for planner in doctor.PLANNERS:
        assert any(line.split()[:2] == ["ok", planner] for line in said.splitlines()), said


def test_networks_do_not_hang_on_the_c_library_either() -> None:
    answers, own = ({name: doctor.answers_hash(name) for name in doctor.NETWORKS}, arithmetic.facts()["answers"])
    others, other = json.loads(under(_NO_FMA, _NETWORKS))
    assert answers == others == {name: reference()["planners"][name]["answers"] for name in doctor.NETWORKS}
    if "X86_V3" in SIMD:
        # The setting does something, and it is seen.
        assert own["libm"] != other["libm"]


@pytest.mark.skipif("avx2" not in Path("/proc/cpuinfo").read_text(), reason="a processor without AVX2 has one kernel")
def test_another_kernel_is_seen() -> None:
    one, other = (json.loads(under({"OPENBLAS_CORETYPE": name}, _FACTS)) for name in ("Haswell", "Prescott"))
    assert one["libm"] == other["libm"]
    assert one["blas"] != other["blas"]


def test_a_planner_that_differs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "PLANNERS", ("idm", "ppo"))
    wrong = reference()
    scenario = next(iter(wrong["planners"]["idm"]["episodes"]))
    wrong["planners"]["idm"]["episodes"][scenario] = wrong["planners"]["ppo"]["answers"] = "0" * 64
    shutil.copy(Path(doctor.__file__).with_name("arithmetic.npz"), tmp_path)
    (tmp_path / "arithmetic.json").write_text(json.dumps(wrong))
    failed = {f.name: f.text for f in doctor.check_arithmetic(tmp_path) if f.status is Status.FAILED}
    assert failed == {"idm": f"differs: episode {scenario}", "ppo": "differs: its network's answers"}


def test_a_reference_that_is_written_is_met(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "PLANNERS", ("idm", "ppo"))
    monkeypatch.setattr(doctor, "NETWORKS", ("ppo",))
    doctor.write_reference(tmp_path)
    assert all(finding.status is Status.OK for finding in doctor.check_arithmetic(tmp_path))
    written = json.loads((tmp_path / "arithmetic.json").read_text())
    assert written["planners"] == {name: reference()["planners"][name] for name in ("idm", "ppo")}


OURS = ["idm", "plant2-ft", "idm-e", "tsbench.make.certify.lawless:Lawless"]
THEIRS = [*OURS, "mine.py:Mine"]


def changed(part: str, name: str) -> arithmetic.Facts:
    other = copy.deepcopy(arithmetic.facts())
    other[part][name] = "another"
    return other


@pytest.mark.parametrize(
    ("part", "name", "ours", "theirs"),
    [
        ("answers", "libm", True, True),
        ("answers", "blas", False, True),
        ("answers", "numpy", False, True),
        ("versions", "numpy", True, True),
        ("versions", "torch", False, True),
    ],
)
def test_who_may_go_on(part: str, name: str, ours: bool, theirs: bool) -> None:
    here, there = arithmetic.facts(), changed(part, name)

    def told(specs: list[str], device: str = "cpu", *, torch: bool) -> bool:
        return bool(arithmetic.differences(there, here, specs, device, torch))

    assert told(THEIRS, torch=True) == theirs
    assert told(THEIRS, torch=False) == (theirs and name != "torch")
    assert told(OURS, torch=True) == told(OURS, torch=False) == ours
    assert told(OURS, "cuda", torch=False)
    there = here
    assert not told(THEIRS, "cuda", torch=True)


def test_all_differences_are_told() -> None:
    here, there = arithmetic.facts(), changed("answers", "libm")
    there["answers"]["blas"] = there["versions"]["numpy"] = "another"
    told = arithmetic.differences(there, here, THEIRS, "cpu")
    assert [line.split(" is ")[0] for line in told] == ["numpy", "the arithmetic of libm", "the arithmetic of blas"]
    assert len(arithmetic.differences(there, here, OURS, "cpu")) == 2
    assert arithmetic.differences(here, here, THEIRS, "cuda") == ()


def test_a_run_says_with_what_it_was_made() -> None:
    new = new_manifest("c", {}, {"device": "cpu"}, [PlannerInfo(p, p, False, True, (), None, None) for p in THEIRS])
    assert new["arithmetic"] == arithmetic.facts()
    assert difference(new, new) is None
    told = difference({**new, "arithmetic": changed("answers", "blas")}, new)
    assert told.startswith("the arithmetic of blas is another")
    assert difference({**new, "arithmetic": None}, new) == "the arithmetic is not recorded"


@pytest.mark.parametrize(
    ("unseen", "loaded", "minded"), [((), False, False), (("torch",), False, True), ((), True, True)]
)
def test_torch_is_minded_where_the_planner_imported_it(
    unseen: tuple[str, ...], loaded: bool, minded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    if loaded:
        monkeypatch.setitem(sys.modules, "torch", sys)
    planner = PlannerInfo("Mine", "mine.py:Mine", False, True, (), None, None, unseen=unseen)
    new = new_manifest("c", {}, {"device": "cpu"}, [planner])
    old = {**new, "arithmetic": changed("versions", "torch")}
    assert (difference(old, new) is not None) == minded
    assert difference({**old, "status": "complete"}, new) is None
