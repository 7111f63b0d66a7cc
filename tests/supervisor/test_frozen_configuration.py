"""The rig that runs is the one that was read, also where a process is started again after a file has changed."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from tests.supervisor.fakes import Fakes, Scenario, until, until_running
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.process.process import Options, load_process_config, parse
from trocar.services.supervisor import frozen_configuration
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.training.scenario import load_scenario, scenario_of

SCENE = "catheter: {}\nduct: {mesh_file: wall.stl}\n"


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of configuration with a rig on a base, a device and a scene of its own."""
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "rigs").mkdir()
    (folder / "rigs" / "below.yaml").write_text((config.config_directory() / "rigs" / "stub.yaml").read_text())
    for kind in ("scenes", "devices", "scenarios", "scores", "scripts"):
        (folder / kind).symlink_to(config.config_directory() / kind)
    arm = "{driver: phantom_simulated, device: my_arm.yaml}"
    row = f"{{name: left, port_m: [0, 0, 0.1], arm: {arm}}}"
    (tmp_path / "mine.yaml").write_text(
        f"base: below\nname: mine\ntransport: {{directory: {tmp_path / 'run'}}}\ngateway: {{instruments: [{row}]}}\n"
    )
    arm_file = next(each for each in (folder / "devices").glob("*.yaml") if "kind: arm" in each.read_text())
    (tmp_path / "my_arm.yaml").write_text(arm_file.read_text())
    (tmp_path / "small.yaml").write_text(SCENE)
    monkeypatch.setenv("TROCAR_CONFIG_DIR", str(folder))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_process_that_is_started_later_reads_what_was_read_first(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TROCAR_SET", "gateway.engage_ramp_s=3")
    options = Options("mine.yaml", "small.yaml", ("gateway.engage_ramp_s=2", "catheter.mass_kg=0.001"))
    read = load_process_config("supervisor", options)
    arguments, environment = frozen_configuration.freeze(read)
    arm = config.load(ArmFile, written / "my_arm.yaml")[0]
    for name in ("mine.yaml", "my_arm.yaml", "small.yaml", "mine/rigs/below.yaml"):
        (written / name).write_text("it is: another")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    again = load_process_config("gateway", parse("gateway", arguments))
    device = again.rig.gateway.instruments[0].arm.device
    assert device is not None
    assert config.load(ArmFile, config.find("device", device))[0] == arm
    assert again.rig.gateway.engage_ramp_s == 2.0
    told = [rig.model_dump(mode="json", exclude={"base", "gateway"}) for rig in (read.rig, again.rig)]
    assert told[0] == told[1]
    scene = config.read_scene(again.scene_name, again.scene_overrides)
    assert scene == {"catheter": {"mass_kg": 0.001}, "duct": {"mesh_file": str(written / "wall.stl")}}
    frozen_configuration.remove(again.rig.transport)
    assert not Path(environment["TROCAR_CONFIG_DIR"]).exists()


@pytest.mark.parametrize("name", ["dev.yaml", "rig.yaml", "scene.yaml"])
def test_files_of_one_name_stay_several(written: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Both arms got the file of the right one, and one that was called as the rig or the scene was overwritten."""
    arm = (written / "my_arm.yaml").read_text()
    for folder in ("a", "b"):
        (written / folder).mkdir()
        (written / folder / name).write_text(f"{arm}# {folder}\n")
    (written / "scene.yaml").write_text(SCENE)
    rows = [
        {"name": hand, "port_m": [0, 0, z], "arm": {"driver": "phantom_simulated", "device": f"{folder}/{name}"}}
        for hand, folder, z in (("left", "a", 0.1), ("right", "b", -0.1))
    ]
    file = written / "mine.yaml"
    file.write_text(yaml.safe_dump({**yaml.safe_load(file.read_text()), "gateway": {"instruments": rows}}))
    arguments, environment = frozen_configuration.freeze(
        load_process_config("supervisor", Options("mine.yaml", "scene.yaml", ()))
    )
    for key, value in environment.items():
        monkeypatch.setenv(key, value)
    again = load_process_config("gateway", parse("gateway", arguments))
    devices = [row.arm.device for row in again.rig.gateway.instruments]
    assert [Path(device).read_text().splitlines()[-1] for device in devices if device] == ["# a", "# b"]
    assert "duct" in config.read_scene(again.scene_name)


def test_scenario_and_script_given_as_files_are_frozen_and_watched(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A training process that was started again read a scenario that had been changed, or was no longer one."""
    for name, kind in (("scenario", "basic"), ("script", "stroke")):
        original = config.config_directory() / f"{name}s" / f"{kind}.yaml"
        (written / f"my_{name}.yaml").write_text(original.read_text())
    set_script = "gateway.instruments.0.arm.settings.script=my_script.yaml"
    options = Options("mine.yaml", None, ("training.scenario=my_scenario.yaml", set_script))
    read = load_process_config("supervisor", options)
    watched = frozen_configuration.files_of(read.rig, "mine.yaml", read.scene_name)
    assert {Path("my_scenario.yaml"), Path("my_script.yaml")} <= watched
    arguments, environment = frozen_configuration.freeze(read)
    before = load_scenario("my_scenario.yaml"), config.read_yaml(written / "my_script.yaml")
    for name in ("my_scenario.yaml", "my_script.yaml"):
        (written / name).write_text("garbage: [")
    for key, value in environment.items():
        monkeypatch.setenv(key, value)
    again = load_process_config("training", parse("training", arguments))
    assert again.rig.training.scenario is not None
    script = again.rig.gateway.instruments[0].arm.settings["script"]
    assert (load_scenario(again.rig.training.scenario), config.read_yaml(Path(script))) == before


def test_a_scenario_of_a_scene_given_as_a_file_is_that_of_the_copy(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Training ended: the scenario was made of small.yaml, and the rig ran another file."""
    (written / "small.yaml").write_text((config.config_directory() / "scenes" / "default.yaml").read_text())
    basic = config.read_yaml(config.config_directory() / "scenarios" / "basic.yaml")
    (written / "my_scenario.yaml").write_text(yaml.safe_dump({**basic, "scene": "small.yaml"}))
    read = load_process_config(
        "supervisor", Options("mine.yaml", "small.yaml", ("training.scenario=my_scenario.yaml",))
    )
    arguments, environment = frozen_configuration.freeze(read)
    for key, value in environment.items():
        monkeypatch.setenv(key, value)
    again = load_process_config("training", parse("training", arguments))
    followed = scenario_of(again.scene_name, again.rig.training.scenario)
    assert followed is not None
    assert followed.goal == load_scenario("my_scenario.yaml").goal


def test_a_scenario_of_another_scene_is_refused_where_the_rig_runs_a_file(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = load_process_config("supervisor", Options("mine.yaml", "small.yaml", ("training.scenario=basic",)))
    arguments, environment = frozen_configuration.freeze(read)
    for key, value in environment.items():
        monkeypatch.setenv(key, value)
    again = load_process_config("training", parse("training", arguments))
    with pytest.raises(ConfigError, match="is made of scene 'default'"):
        scenario_of(again.scene_name, again.rig.training.scenario)


def test_a_file_that_changed_is_said_once(written: Path) -> None:
    rig = config.load_rig("mine.yaml")
    files = frozen_configuration.files_of(rig, "mine.yaml", "small.yaml")
    assert {path.name for path in files} == {
        "mine.yaml",
        "below.yaml",
        "my_arm.yaml",
        "grasp_odrive.yaml",
        "small.yaml",
    }
    said: list[str] = []
    changed = frozen_configuration.ChangedFiles(files, lambda _level, text: said.append(text))
    changed.run_turn(1.0)
    os.utime(written / "small.yaml")
    changed.run_turn(3.0)
    assert said == []
    (written / "small.yaml").write_text(f"{SCENE}# and more\n")
    for now_s in (3.5, 5.0, 7.0):
        changed.run_turn(now_s)
    assert said == [
        "supervisor: small.yaml has changed since the rig began, which goes on as it was read; "
        "the next start takes the change"
    ]


def _rig_of(pid: int) -> Rig:
    """Return the rig that a process was told to be of, as it would read it now."""
    environment = Path(f"/proc/{pid}/environ").read_bytes().decode().split("\0")
    assert any(each.startswith("TROCAR_CONFIG_DIR=") for each in environment)
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    return config.load_rig(words[words.index("--rig") + 1])


def test_who_is_started_again_runs_the_rig_that_began(fakes: Fakes) -> None:
    file = Path(fakes.options.rig)
    fakes = replace(fakes, options=replace(fakes.options, overrides=("gateway.engage_ramp_s=2",)))

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        data = yaml.safe_load(file.read_text())
        file.write_text(yaml.safe_dump({**data, "supervisor": {"heartbeat_timeout_s": 9}, "gateway": "nonsense"}))
        member = supervisor.crew.members["haptics"]
        first = member.pid
        os.kill(first, signal.SIGKILL)
        yield from until(lambda: member.up and member.pid != first)
        rig = _rig_of(member.pid)
        assert (rig.supervisor, rig.gateway.engage_ramp_s) == (supervisor.rig.supervisor, 2.0)
        yield from until(lambda: any("has changed since the rig began" in event.text for event in supervisor.events))

    events = fakes.play(scenario)
    assert sum(f"{file} has changed since the rig began" in event for event in events) == 1
    assert not (file.parent / "configuration").exists()
