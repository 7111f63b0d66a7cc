"""A scene that names a tissue has its wall, but for what the scene says itself."""

import json

import pytest
from typer.testing import CliRunner

from trocar.services.cli.app import app
from trocar.services.mechanics.scene.tissue import TISSUES
from trocar.services.scenes import load_scene, scene_origins


def written(tmp_path, text):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", TISSUES)
def test_the_wall_is_the_tissues(tmp_path, name):
    effects = "{viscoelasticity: {}, hyperelasticity: {}}"
    scene = load_scene(written(tmp_path, f"{{duct: {{tissue: {name}}}, effects: {effects}}}"))
    wanted = TISSUES[name]
    assert scene.duct.thickness_m == wanted.thickness_m.value
    assert scene.duct.youngs_modulus_pa == wanted.axial_modulus_pa.value
    assert scene.duct.density_kg_m3 == wanted.density_kg_m3.value
    assert scene.effects["viscoelasticity"].series() == wanted.prony_series()
    assert scene.effects["hyperelasticity"].exponent == wanted.stiffening_exponent.value
    if wanted.axial_modulus_pa.value == wanted.circumferential_modulus_pa.value:
        assert "anisotropy" not in scene.effects
    else:
        modulus = scene.effects["anisotropy"].modulus_ratio * scene.duct.youngs_modulus_pa
        assert modulus == pytest.approx(wanted.circumferential_modulus_pa.value)


def test_relaxation_and_stiffening_are_no_effects_that_a_tissue_brings(tmp_path):
    scene = load_scene(written(tmp_path, "duct: {tissue: soft_cystic_duct}"))
    assert set(scene.effects) == {"anisotropy"}


def test_what_the_scene_says_goes_before(tmp_path):
    text = """
        duct: {tissue: porcine_common_bile_duct, thickness_m: 1.1e-3}
        effects: {anisotropy: {modulus_ratio: 2.0}, viscoelasticity: {g: [0.3], tau_s: [2.0]}}"""
    scene, origins = scene_origins(written(tmp_path, text), ["duct.youngs_modulus_pa=70e3"])
    assert (scene.duct.thickness_m, scene.duct.youngs_modulus_pa) == (1.1e-3, 70e3)
    assert scene.effects["anisotropy"].modulus_ratio == 2.0
    assert scene.effects["viscoelasticity"].tau_s == (2.0,)
    assert origins["duct.youngs_modulus_pa"] == "--set"
    assert origins["duct.density_kg_m3"] == "tissue porcine_common_bile_duct"


def test_an_override_names_one_too(tmp_path):
    scene = load_scene(written(tmp_path, "duct: {length_m: 30.0e-3}"), ["duct.tissue=soft_cystic_duct"])
    assert scene.duct.youngs_modulus_pa == TISSUES["soft_cystic_duct"].axial_modulus_pa.value


def test_all_are_listed_with_their_sources():
    said = json.loads(CliRunner().invoke(app, ["tissues", "--json"]).stdout)["tissues"]
    assert set(said) == set(TISSUES)
    assert all(quantity["source"] for preset in said.values() for quantity in preset.values())
    stretched = json.loads(CliRunner().invoke(app, ["tissues", "--json"]).stdout)["distension"]
    measured = stretched["porcine_common_bile_duct"]["measured"]
    assert stretched["porcine_common_bile_duct"]["along"] == pytest.approx(measured["along"], rel=0.01)
    assert stretched["reference_duct"]["measured"] is None
    shown = CliRunner().invoke(app, ["tissues"]).stdout
    assert all(name in shown for name in TISSUES)
    assert shown.count("at 5 kPa") >= len(TISSUES)
    assert "measured: 25 and 8 %" in shown
