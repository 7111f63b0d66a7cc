"""An element is one file and one row: the contract suite finds it, passes the recipe's and fails wrong ones."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

ELEMENTS = Path("services/mechanics/fem/elements")
SUITE = "tests/mechanics/fem/test_element_contract.py"

#: What is spoiled in a copy of the recipe's element, and the test of the contract that must see it.
WRONG = {
    "asymmetric": ("return K\n", "return K * np.linspace(1.0, 1.1, 9)\n", "symmetric"),
    "without_drilling_stiffness": ("@ B + drilling)", "@ B + 0.0 * drilling)", "nothing_else_does"),
    "resists_rigid_rotation": ("difference[:, :, 1::3] = -0.5", "difference[:, :, 1::3] = -0.4", "rigid_motions"),
    "a_tenth_too_stiff": ("@ rigidity @ B", "@ (1.1 * rigidity) @ B", "patch_test"),
    "strains_the_normal_only": ("@ rigidity @ B", "@ (rigidity * np.eye(3)) @ B", "patch_test"),
    "prefers_its_first_node": ("PRODUCTS @", "(PRODUCTS + np.diag([0.1, 0, 0])) @", "first"),
    "prefers_an_axis": ("+ drilling)", "+ drilling * (1.0 + gradient[:, :1, :1] ** 2))", "turned"),
    "averages_its_batch": ("area * (B", "area.mean() * (B", "batch"),
    "hardens": ("rigidity[:, 2:, 2:] * (", "rigidity[:, 2:, 2:] ** 2 * (", "proportional"),
}
#: Rows that say what is not so of elements that are as they were, and the test that must see it.
WRONG_ROWS = {
    "tocher_as_if_consistent": ("Element(tocher.stiffness)", "patch_test_on"),
    "dkt_as_if_for_comparison": ("Element(dkt.stiffness, is_reference_only=True)", "comparison_only"),
    "a_membrane_that_shall_bend": ("Element(cst.stiffness)", "rigid_motions"),
    "dkt_as_if_it_had_drilling": ("Element(dkt.stiffness, has_stiff_drilling=True)", "drilling_is_stiff"),
}
FREQUENCIES = """
from pathlib import Path
from trocar.services.scenes import load_duct, load_scene
small = ["duct.n_around=12", "duct.n_along=10", "duct.n_modes=4", "duct.residual=none"]
scene = load_scene("my-insertion", small)
print(scene.duct.membrane, *load_duct(scene, Path("cache"), lambda stage, fraction: None).basis.omega_rad_s)
"""


@pytest.fixture(scope="module")
def followed(tree_of_module: TreeCopy) -> TreeCopy:
    tree_of_module.follow("Adding an element")
    return tree_of_module


def test_an_element_is_one_file_and_one_row(followed: TreeCopy) -> None:
    """The recipe runs the contract and both commands; here what came of it, and that an edit reaches the basis."""
    assert json.loads((followed.root / "my-duct.json").read_text())["static"]["largest_displacement_m"] > 0.0
    name, *usual = followed.python(FREQUENCIES).split()
    assert name == "hughes_brezzi"
    file = followed.root / ELEMENTS / "hughes_brezzi.py"
    good = file.read_text()
    _spoil(followed, "hughes_brezzi", "a_tenth_too_stiff")
    _, *stiffer = followed.python(FREQUENCIES).split()
    file.write_text(good)
    assert float(stiffer[0]) > 1.02 * float(usual[0])


def test_the_contract_sees_what_is_wrong_with_an_element(followed: TreeCopy) -> None:
    """All wrong ones in one run; the recipe's own passes among them."""
    table = followed.root / ELEMENTS / "__init__.py"
    text = table.read_text()
    for name in WRONG:
        _spoil(followed, name, name)
    imports = "".join(f"from trocar.services.mechanics.fem.elements import {name}\n" for name in WRONG)
    membranes = "".join(f'    "{name}": Element({name}.stiffness),\n' for name in WRONG)
    bendings = "".join(f'    "{name}": {row},\n' for name, (row, _) in WRONG_ROWS.items())
    text = text.replace("\nMEMBRANE_ELEMENTS", f"{imports}\nMEMBRANE_ELEMENTS", 1)
    text = text.replace(
        "MEMBRANE_ELEMENTS: dict[str, Element] = {\n", f"MEMBRANE_ELEMENTS: dict[str, Element] = {{\n{membranes}"
    )
    table.write_text(
        text.replace(
            "BENDING_ELEMENTS: dict[str, Element] = {\n", f"BENDING_ELEMENTS: dict[str, Element] = {{\n{bendings}"
        )
    )
    failed = followed.failed_tests(SUITE)
    assert failed.pop("hughes_brezzi") == set()
    for name, seen_by in {
        **{name: test for name, (_, _, test) in WRONG.items()},
        **{n: t for n, (_, t) in WRONG_ROWS.items()},
    }.items():
        assert any(seen_by in test for test in failed[name]), f"{name}: {failed[name]}"


def _spoil(tree: TreeCopy, name: str, how: str) -> None:
    """Write the recipe's element, spoiled, as the file of an element of this name."""
    good = (tree.root / ELEMENTS / "hughes_brezzi.py").read_text()
    before, after, _ = WRONG[how]
    assert before in good, how
    (tree.root / ELEMENTS / f"{name}.py").write_text(good.replace(before, after))
