"""Which files something consists of, and what of a file counts."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsbench.core.provenance import closure, data_hash, digest, versions

SOURCE = '''"""About this."""
import math


class One:
    """About one."""

    size: float = 1.0

    def area(self, factor: int = 2) -> str:
        """About area."""
        text = f"{self.size * factor!r:>{factor}} \\u00e9 {math.pi:.2f}" "and more" f" {factor=}"
        return text if not text.isspace() else "\\U0001fae8"
'''
# The same on every version of Python: how a tree is written down must not change with it.
KNOWN = "57630996a95262fcd328398446f4859080270dabff52563fb56bb120df98fc5e"


def code(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return closure([path])[path.name]


def names(*starts: str) -> set[str]:
    return set(closure(starts))


def test_what_is_imported_belongs_to_it_with_its_packages() -> None:
    found = names("tsbench.planners.experts.expert")
    assert {
        "tsbench/planners/idm.py",
        "tsbench/planners/experts/rules/detour.py",
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
    file.write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import one\nelse:\n    import two\n"
    )
    assert set(closure([file])) == {"start.py", "two.py"}


def test_installed_packages_and_pythons_own_are_not_followed(tmp_path: Path) -> None:
    site = tmp_path / "site-packages"
    for name in ("mine", "theirs"):
        (site / name).mkdir(parents=True)
        (site / name / "__init__.py").write_text("import theirs, json, numpy\n")
    assert set(closure([site / "mine" / "__init__.py"])) == {"mine/__init__.py"}


def test_a_folder_of_data_does_not_hide_its_module(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from tsbench.planners.weights import load_weights\n")
    assert "tsbench/planners/weights.py" in closure([file])


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


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("import math", "import math  # for pi", True),
        ('"""About one."""', '"""Not about one."""', True),
        ('        """About area."""\n', "", True),
        ("factor: int = 2) -> str", "factor:   int=2,)->str", True),
        ("factor: int = 2", "factor: int = 3", False),
        ("factor: int = 2", "factor: int = True", False),
        ("1.0", "1", False),
        ("1.0", "1.00", True),
        ("not text.", "text.", False),
        ("and more", "and  more", False),
        ("!r:", "!s:", False),
        ("class One", "class Two", False),
    ],
)
def test_what_of_a_file_counts(tmp_path: Path, old: str, new: str, same: bool) -> None:
    assert old in SOURCE
    before = code(tmp_path / "a.py", SOURCE)
    assert (code(tmp_path / "a.py", SOURCE.replace(old, new, 1)) == before) is same


def test_a_file_has_one_digest_on_every_python(tmp_path: Path) -> None:
    assert code(tmp_path / "a.py", SOURCE) == KNOWN


def test_what_is_no_python_counts_by_its_bytes(tmp_path: Path) -> None:
    first, second = (code(tmp_path / "a.py", text) for text in ("print 1", "print  1"))
    assert first != second


def test_rows_in_any_order_and_dictionaries_too() -> None:
    assert data_hash((), [{"a": 1, "b": 2}]) == data_hash((), [{"b": 2, "a": 1}])
    assert digest([1, 2]) != digest([2, 1])
    assert versions(["numpy", "no-such-package"])["no-such-package"] is None
