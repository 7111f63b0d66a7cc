from __future__ import annotations

import json

import pytest
import yaml

from tests.by_day import by_day
from tests.cli.conftest import Trocar
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.scenes import build_scene, load_scene


def test_shown_rig_is_a_rig_file_again(trocar: Trocar) -> None:
    ran = trocar("config", "show", "--rig", "stub", "--set", "supervisor.window_s=3.5")
    assert ran.code == 0
    rig = config.build(Rig, yaml.safe_load(ran.out), "shown")
    assert rig.supervisor.window_s == 3.5
    assert rig.name == "stub"


def test_origin_of_every_value(trocar: Trocar) -> None:
    ran = trocar("config", "show", "--origin", "--json", "--set", "supervisor.window_s=3.5")
    shown = json.loads(ran.out)
    assert shown["supervisor.window_s"] == {"value": 3.5, "origin": "--set"}
    assert shown["name"]["origin"].endswith("stub.yaml")
    assert shown["supervisor.max_restarts_per_minute"]["origin"] == "default"
    assert shown["gateway.instruments.0.name"]["origin"].endswith("stub.yaml")


@pytest.mark.parametrize("name", ["pinch", "duct-only"])
def test_shown_scene_is_a_scene_file_again(name: str, trocar: Trocar) -> None:
    shown = yaml.safe_load(trocar("config", "show", "--scene", name).out)
    assert build_scene(shown, "shown") == load_scene(name)


def test_scene_and_its_override(trocar: Trocar) -> None:
    ran = trocar("config", "show", "--scene", "default", "--json", "--set", "duct.n_modes=12")
    assert json.loads(ran.out)["duct"]["n_modes"] == 12


def test_device(trocar: Trocar) -> None:
    assert json.loads(trocar("config", "show", "--device", "phantom_premium_1_5", "--json").out)["max_force_n"] == 8.5


def test_a_name_that_is_empty_is_not_the_default_s(trocar: Trocar) -> None:
    assert "--scene is empty" in trocar("config", "show", "--scene", "").sentence()


def test_two_at_a_time_are_refused(trocar: Trocar) -> None:
    ran = trocar("config", "show", "--rig", "stub", "--scene", "default")
    assert ran.code == 2
    assert "one at a time" in ran.sentence()


def test_schemas(trocar: Trocar) -> None:
    for kind, key in (("rig", "contracts"), ("scene", "duct")):
        assert key in json.loads(trocar("config", "schema", kind).out)["properties"]
    assert "ArmFile" in trocar("config", "schema", "device").out
    ran = trocar("config", "schema", "moon")
    assert ran.code == 2
    assert "known: rig, scene, device" in ran.sentence()


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("duct.length_m=-0.04", "duct.length_m: must be positive, is -0.04"),
        ("forceps.1.jaw_radius_m=-1e-3", "forceps.1.jaw_radius_m: must be positive, is -0.001"),
        ("catheter.outer_diameter_m=0.0", "catheter.outer_diameter_m: must be positive, is 0.0"),
        ("duct.damping_ratio=-0.1", "duct.damping_ratio: must not be negative, is -0.1"),
        ("quality=[]", "quality: needs one to 16 rungs, has 0"),
        ("duct.mesh_file=nowhere.stl", "nowhere.stl: no such file"),
        ("duct.n_modes=6000", "n_modes: must not be above 2000, is 6000"),
        ("duct.poisson_ratio=0.6", "poisson_ratio of an isotropic material must not exceed 0.5"),
        (
            "effects.large_rotations={n_sections: 500}",
            "effects.large_rotations: the mesh is too coarse for 500 cross-sections: one of them holds no node",
        ),
        (
            "effects.large_rotations={n_sections: 1000000000}",
            "effects.large_rotations: the mesh is too coarse for 1000000000 cross-sections: it has 5112 nodes",
        ),
    ],
)
@pytest.mark.parametrize("by", by_day(["scene"], ["rig"]))
def test_what_up_would_refuse_is_refused(trocar: Trocar, by: str, override: str, sentence: str) -> None:
    name = "default" if by == "scene" else "stub"
    ran = trocar("config", "show", f"--{by}", name, "--set", override)
    assert ran.code == 2
    assert ran.sentence().startswith(f"--set {override}: ")
    assert ran.sentence().endswith(sentence)
    assert "default.yaml" not in ran.sentence()  # which is not at fault


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("scene=nowhere", "there is no scene 'nowhere'"),
        ("gateway.instruments.0.arm.driver=nobody", "instrument 'left': there is no driver 'nobody'"),
        ("gateway.instruments.0.arm.device=nothing", "there is no device 'nothing'"),
        ("transport={kind: tcp, keys: /nowhere}", "transport.keys: /nowhere/rig.key_secret: No such file or directory"),
        (f"transport.directory=/tmp/{'x' * 90}", "characters, the system allows 107"),
        ("transport.hosts={gatway: 10.0.0.1}", "transport.hosts.gatway: there is no process 'gatway'; known: gateway"),
        ("gateway.instruments.0.arm.settings.scrpt=insertion", "scrpt: unknown key 'scrpt'; known:"),
    ],
)
def test_a_rig_with_what_is_not_there_is_refused(trocar: Trocar, override: str, sentence: str) -> None:
    ran = trocar("config", "show", "--rig", "stub", "--set", override)
    assert ran.code in (2, 3, 4)
    assert sentence in ran.sentence()
