"""Which files something consists of, and what of a file counts."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.core.provenance import closure, data_hash, digest, versions


def names(*starts: str) -> set[str]:
    return set(closure(starts))


def test_what_is_imported_belongs_to_it_with_its_packages() -> None:
    found = names("tsbench.planners.experts.expert")
    assert {
        "tsbench/planners/idm.py",
        "tsbench/planners/experts/rules/detour_constraint.py",
        "tsbench/sim/ego.py",
    } <= found
    assert {
        "tsbench/__init__.py",
        "tsbench/planners/__init__.py",
        "tsbench/planners/experts/rules/__init__.py",
    } <= found
    assert "tsbench/planners/check.py" not in found
    assert all(name.startswith("tsbench/") for name in found)


def test_every_kind_of_import_counts(tmp_path: Path) -> None:
    package = tmp_path / "pack"
    (package / "deep").mkdir(parents=True)
    (tmp_path / "bare").mkdir()
    for name in ("one", "two", "three", "four", "five", "six"):
        (package / f"{name}.py").write_text("")
    (package / "__init__.py").write_text("from . import six")
    (package / "deep" / "__init__.py").write_text("")
    (package / "more").mkdir()
    for name in ("__init__", "seven"):
        (package / "more" / f"{name}.py").write_text("")
    (tmp_path / "bare" / "inner.py").write_text("")
    (package / "deep" / "start.py").write_text(
        "import pack.one, json\nfrom pack import two\nfrom ..three import x\n"
        "def f():\n    from .. import four\n    import bare.inner\n    import importlib\n"
        "    importlib.import_module('pack.five')\n    import_all('pack.more')\n"
    )
    found = closure([package / "deep" / "start.py"])
    assert set(found) == {
        "bare/inner.py", "pack/__init__.py", "pack/deep/__init__.py", "pack/deep/start.py",
        *(f"pack/{name}.py" for name in ("one", "two", "three", "four", "five", "six")),
        "pack/more/__init__.py", "pack/more/seven.py",
    }  # fmt: skip
    assert "pack/six.py" not in closure([package / "deep" / "start.py"], {"pack/__init__.py"})


def test_what_is_for_type_checkers_does_not_run(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("")
    (tmp_path / "two.py").write_text("")
    file = tmp_path / "start.py"
    file.write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import one\nelse:\n    import two\n")
    assert set(closure([file])) == {"start.py", "two.py"}


def test_installed_packages_and_pythons_own_are_not_followed(tmp_path: Path) -> None:
    site = tmp_path / "site-packages"
    for name in ("mine", "another_package"):
        (site / name).mkdir(parents=True)
        (site / name / "__init__.py").write_text("import another_package, json, numpy\n")
    assert set(closure([site / "mine" / "__init__.py"])) == {"mine/__init__.py"}


def test_a_folder_of_data_does_not_hide_its_module() -> None:
    assert "tsbench/planners/weights.py" in closure(["tsbench.planners.builtin"])


def test_a_data_file_that_is_named_counts(tmp_path: Path) -> None:
    file = tmp_path / "start.py"
    file.write_text('"""Not nets/b.json."""\nNETS = ["nets/a.json", "nets/b" ".txt", "nets/gone.json"]\n')
    (tmp_path / "nets").mkdir()
    for name in ("a.json", "b.json", "b.txt"):
        (tmp_path / "nets" / name).write_text(name)
    first = closure([file])
    assert set(first) == {"start.py", "start.py: nets/a.json"}
    (tmp_path / "nets" / "a.json").write_text("other")
    assert closure([file])["start.py: nets/a.json"] != first["start.py: nets/a.json"]


def test_a_file_counts_by_its_bytes(tmp_path: Path) -> None:
    file = tmp_path / "a.py"
    found = set()
    for text in ('"""Gain 1."""', '"""Gain 2."""', "# gain 1", "# gain 2", "\n# gain 2", "print 1", "print  1"):
        file.write_text(text, encoding="utf-8")
        found.add(closure([file])["a.py"])
    assert len(found) == 7


def test_tsbench_is_followed_from_its_own_modules_only(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from tsbench.planners.weights import load_weights\n")
    assert set(closure([file])) == {"mine.py"}


@pytest.mark.parametrize(
    "text",
    [
        "GAIN = " + "1+" * 40_000 + "1\n",
        "x = " + "(" * 5_000 + ")" * 5_000 + "\n",
        f"NET = '{'n' * 5_000}.json'\n",
        "NET = '" + "\u0436" * 200 + ".json'\n",
        "NET = '\\ud800.json'\nOTHER = 'a\\0.json'\n",
        "#" * (2 << 20) + "\nimport other\n",
    ],
    ids=["terms", "brackets", "long", "wide", "surrogate", "large"],
)
def test_odd_modules_count_by_their_bytes(tmp_path: Path, text: str) -> None:
    file = tmp_path / "odd.py"
    file.write_text(text, encoding="utf-8")
    (tmp_path / "other.py").touch()
    assert set(closure([file])) == {"odd.py"}


def test_files_too_large_are_refused_before_they_are_read(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text('NET = "net.pt"\n')
    with (tmp_path / "net.pt").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError, match=r"net\.pt: with it the planner's files have more than 8 GiB"):
        closure([tmp_path / "mine.py"])


def test_windows_into_the_kernel_are_not_read(tmp_path: Path) -> None:
    """Reading this one waits for ever."""
    (tmp_path / "mine.py").write_text("import log\n")
    (tmp_path / "log.py").symlink_to("/proc/kmsg")
    assert closure([tmp_path / "mine.py"])["log.py"] == hashlib.sha256().hexdigest()


def test_a_data_file_elsewhere_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "own"
    own.mkdir()
    monkeypatch.chdir(own)
    (tmp_path / "secret.json").touch()
    (own / "link.json").symlink_to(tmp_path / "secret.json")
    (own / "mine.py").write_text('NAMES = ["link.json", "../secret.json"]\n')
    assert set(closure([own / "mine.py"])) == {"mine.py"}


def test_rows_in_any_order_and_dictionaries_too() -> None:
    assert data_hash((), [{"a": 1, "b": 2}]) == data_hash((), [{"b": 2, "a": 1}])
    assert digest([1, 2]) != digest([2, 1])
    assert versions(["numpy", "no-such-package"])["no-such-package"] is None
