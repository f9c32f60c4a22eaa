"""Which files a module consists of."""

from __future__ import annotations

from pathlib import Path

import tsbench
from tsbench.sources import closure

ROOT = Path(tsbench.__file__).parent
PLANNERS = ROOT / "planners"


def names(start: str, *within: str) -> set[str]:
    return {p.relative_to(ROOT).as_posix() for p in closure([ROOT / start], within)}


def test_what_is_imported_belongs_to_it() -> None:
    found = names("planners/expert.py", "tsbench.planners")
    assert {"planners/expert.py", "planners/idm.py", "planners/base.py", "planners/guards/detour.py"} <= found
    assert "planners/check.py" not in found


def test_other_packages_are_not_followed() -> None:
    assert names("planners/expert.py", "tsbench.certify") == {"planners/expert.py"}
    assert all(name.startswith("planners/") for name in names("planners/idm.py", "tsbench.planners"))


def test_an_import_inside_a_function_counts(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "def f():\n    from tsbench.planners import gaps\n    import tsbench.planners.idm\n    import math\n"
    )
    found = {p.name for p in closure([file], ["tsbench.planners"])}
    assert {"mine.py", "gaps.py", "idm.py"} <= found


def test_a_folder_of_data_does_not_hide_its_module(tmp_path: Path) -> None:
    assert (PLANNERS / "weights.py").is_file()
    file = tmp_path / "mine.py"
    file.write_text("from tsbench.planners.weights import load_weights\n")
    assert PLANNERS / "weights.py" in closure([file], ["tsbench.planners"])
