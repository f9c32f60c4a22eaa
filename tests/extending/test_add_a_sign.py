"""A sign of a kind of rule that is there: one YAML, and a drawing where none fits. docs/signs.md, "Adding a sign"."""

from __future__ import annotations

from own_copy import Copy, records
from PIL import Image

from tsbench.signs.catalog import load_catalog

# Of no law: what 3.18.2 and 3.19 ask together.
CODE = "3.18.3"
DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200">
  <circle cx="100" cy="100" r="88" fill="#ffffff" stroke="#c1121f" stroke-width="22"/>
  <path d="M130 150 V80 H80 v40" fill="none" stroke="#1a1a1a" stroke-width="14"/>
</svg>
"""


def add_the_sign(clone: Copy) -> None:
    text = clone.like(
        "sign_catalog/signs/3.18.2.yaml",
        ('"3.18.2"', f'"{CODE}"'), ("en: No left turn", "en: Neither left turn nor U-turn"),
        ("3.18.2.svg", "neither.svg"), ("[straight, right, u_turn]", "[straight, right]"),
        ('mirrored: "3.18.1"\n', ""),
    )  # fmt: skip
    clone.write(f"sign_catalog/signs/{CODE}.yaml", text)
    clone.write("sign_catalog/plates/neither.svg", DRAWING)


def test_a_sign_is_one_file_and_its_drawing(clone: Copy) -> None:
    add_the_sign(clone)
    # A scene that has it is driven, judged by its rule and recorded under its code.
    row = clone.scene("no_turn_left", sign_code=CODE)
    told = clone.tsbench(
        "signs list",
        f"signs show {CODE}",
        "signs equivalents --country de",
        "signs sheet --out sheet.png",
        "run --planner idm --planner idm-e --split test --out run",
        "scenarios list --split test",
    )
    assert "35 signs, 29 scenario types" in told
    assert "Neither left turn nor U-turn" in told
    assert any(line.startswith(CODE) and "unknown" in line for line in told.splitlines())
    with Image.open(clone.root / "sheet.png") as sheet:
        assert sheet.width > 1000
    found = records(clone.root / "run")
    assert {r["sign_code"] for r in found.values()} == {CODE}
    assert (found["idm"]["scd"], found["idm"]["violation_clause"]) == (False, "prohibited_manoeuvre")
    assert found["idm-e"]["scd"] is True
    assert row.scenario_id in told.splitlines()


def test_a_new_sign_changes_no_other(clone: Copy) -> None:
    """Certificates and contracts of scenes without it stand."""
    add_the_sign(clone)
    grown, shipped = load_catalog(clone.root / "sign_catalog"), load_catalog()
    assert grown.contract_entries(shipped.signs) == shipped.contract_entries(shipped.signs)
