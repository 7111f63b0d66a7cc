from __future__ import annotations

import json

import yaml

from services.runtime import config
from services.runtime.rig import Rig
from tests.cli.conftest import Trocar


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


def test_scene_and_its_override(trocar: Trocar) -> None:
    ran = trocar("config", "show", "--scene", "default", "--json", "--set", "duct.n_modes=12")
    assert json.loads(ran.out)["duct"]["n_modes"] == 12


def test_device(trocar: Trocar) -> None:
    assert json.loads(trocar("config", "show", "--device", "phantom_premium_1_5", "--json").out)["max_force_n"] == 8.5


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
