"""Catheters and wires as sold: their files are sound, and a scene that names one has their values."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from tests.refusals import assert_refused
from trocar.services.cli.app import app
from trocar.services.mechanics.scene import CatheterScene, CatheterSection, GuideWireScene
from trocar.services.runtime.config import config
from trocar.services.runtime.config.products import load_product, product_names
from trocar.services.scenes.load import load_scene, scene_origins

HARRISON_GPA = {"amplatz": 9.5, "amplatz_stiff": 17.0, "amplatz_extra_stiff": 29.2, "amplatz_super_stiff": 60.3,
                "lunderquist_extra_stiff": 158.4}  # fmt: skip


def scene_of(folder: Path, catheter: dict) -> Path:
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump({"catheter": catheter, "effects": {"twist": {}}}))
    return path


@pytest.mark.parametrize("name", product_names())
def test_every_value_is_a_key_of_a_scene_with_its_source(name: str) -> None:
    product = load_product(name)
    kind = CatheterScene if product.kind == "catheter" else GuideWireScene
    assert set(product.values) <= {field.name for field in fields(kind)} - {"product", "sections"}
    for section in product.sections:
        assert set(section) <= {field.name for field in fields(CatheterSection)}
    for value in product.named_values().values():
        assert value.source
        assert value.assumed or not value.source.startswith("assum")


@pytest.mark.parametrize("name", product_names())
def test_every_product_makes_a_scene(name: str, tmp_path: Path) -> None:
    product = load_product(name)
    if product.kind == "catheter":
        catheter = load_scene(scene_of(tmp_path, {"product": name})).catheter
        assert {key: getattr(catheter, key) for key in product.values} == {
            k: v.value for k, v in product.values.items()
        }
        return
    drives = [{"kind": "drive"}, {"kind": "wire_drive"}]
    made = {"product": "cholangiography_5fr", "guide_wire": {"product": name}, "length_m": 0.2}
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump({"catheter": made, "forceps": drives, "effects": {"twist": {}}, "hands": "none"}))
    wire = load_scene(path).catheter.guide_wire
    assert wire is not None
    assert wire.youngs_modulus_pa == product.values["youngs_modulus_pa"].value
    assert wire.sections[0].youngs_modulus_pa < 0.2 * wire.youngs_modulus_pa


def test_wires_are_as_stiff_as_harrison_measured() -> None:
    for name, gpa in HARRISON_GPA.items():
        assert load_product(f"wire_035_{name}").values["youngs_modulus_pa"].value == pytest.approx(1e9 * gpa)


def test_what_the_scene_says_goes_before(tmp_path: Path) -> None:
    path = scene_of(tmp_path, {"product": "cholangiography_4fr", "youngs_modulus_pa": 5e7})
    scene, origins = scene_origins(path, ["catheter.inner_diameter_m=0.5e-3"])
    assert (scene.catheter.youngs_modulus_pa, scene.catheter.inner_diameter_m) == (5e7, 0.5e-3)
    assert scene.catheter.outer_diameter_m == 1.33e-3
    assert origins["catheter.outer_diameter_m"] == "product cholangiography_4fr"


def test_a_saved_scene_needs_no_product(tmp_path: Path) -> None:
    path = scene_of(tmp_path, {"product": "mine.yaml"})
    mine = yaml.safe_load((config.config_directory() / "catheters" / "cholangiography_4fr.yaml").read_text())
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(mine))
    saved = tmp_path / "saved" / "scene.yaml"
    saved.parent.mkdir()
    saved.write_text(yaml.safe_dump(config.read_scene(path)))
    assert load_scene(saved).catheter == load_scene(path).catheter


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"value": 2.0e-3}, "outer_diameter_m: 0.002 is outside its own range"),
        ({"sourse": "a"}, "sourse"),
        ({"value": "wide"}, "values.outer_diameter_m.value"),
    ],
)
def test_a_mistake_in_a_product_is_one_sentence(tmp_path: Path, changed: dict, told: str) -> None:
    mine = yaml.safe_load((config.config_directory() / "catheters" / "cholangiography_4fr.yaml").read_text())
    mine["values"]["outer_diameter_m"] |= changed
    assert_refused(load_product, tmp_path / "mine.yaml", yaml.safe_dump(mine), told)


def test_they_are_listed() -> None:
    told = json.loads(CliRunner().invoke(app, ["catheters", "--json"]).stdout)["products"]
    assert list(told) == product_names()
    shown = CliRunner().invoke(app, ["catheters"], env={"COLUMNS": "250"}).stdout
    assert "assumption; wall not measured" in shown
