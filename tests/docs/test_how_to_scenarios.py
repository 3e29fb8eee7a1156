"""The scenarios of how-to pages load, assemble and hold what the page says of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import flexarm

PAGES = Path(__file__).resolve().parents[2] / "docs" / "how-to"


def scenarios(page: str) -> dict[str, str]:
    """Every scenario of a page, by its name."""
    texts = re.findall(r"```yaml\n(schema:.*?)```", (PAGES / page).read_text(encoding="utf-8"), re.DOTALL)
    return {re.search(r"^name: (\S+)", text, re.MULTILINE)[1]: text for text in texts}  # type: ignore[index]


def test_values_are_calculated(tmp_path: Path) -> None:
    (tmp_path / "axis.yaml").write_text(scenarios("calculate-values.md")["belt-axis"])
    loaded = flexarm.load(tmp_path / "axis.yaml")
    values = {name: block.values for name, block in loaded.system.blocks.items()}
    assert values["pulley"]["radius"] == pytest.approx(20 * 0.005 / (2 * 3.141592653589793))
    assert values["carriage"]["mass"] == pytest.approx(2.9)
    assert values["guide"]["coulomb_friction"] == pytest.approx(0.004 * 2.5 * 9.81)
    assert {"teeth", "pitch", "carriage"} <= {p.name for p in loaded.build().parameters}


def test_a_machine_of_two_joints(tmp_path: Path) -> None:
    for name, text in scenarios("sub-assemblies.md").items():
        (tmp_path / f"{name}.yaml").write_text(text)
    loaded = flexarm.load(tmp_path / "two-joints.yaml")
    model = loaded.build()
    ratio = model.parameters[model.parameter_index("ratio")]
    assert {user.split(".")[0] for user in ratio.users} == {"left", "right"}
    assert loaded.system.blocks["left.body"].values["inertia"] == pytest.approx(0.1 + 0.05 * 0.8)
    assert loaded.system.blocks["right.body"].values["inertia"] == pytest.approx(0.2)
    assert loaded.system.blocks["right.gear"].values["stiffness"] == 2e4
