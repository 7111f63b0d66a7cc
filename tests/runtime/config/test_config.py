"""Configuration: typed, origins known, and every mistake one sentence that names file and key."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig, Settings
from trocar.services.runtime.errors import ConfigError


def write(path: Path, text: str) -> Path:
    file = path / "rig.yaml"
    file.write_text(text)
    return file


class Wheel(Settings):
    kind: Literal["wheel"]
    radius_m: float


class Rail(Settings):
    kind: Literal["rail"]
    gauge_m: float


class Axle(Settings):
    length_m: float


class Cart(Settings):
    on: Annotated[Wheel | Rail, Field(discriminator="kind")] | None = None
    parts: tuple[Annotated[Wheel | Rail, Field(discriminator="kind")], ...] = ()
    ends: tuple[Axle, Wheel] | None = None
    either: Axle | Rail | None = None
    named: dict[str, Axle] | None = None


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"on": {"kind": "rail", "gage_m": 1.0}}, "on.rail.gage_m: unknown key 'gage_m'; known: gauge_m, kind (and"),
        ({"parts": [{"kind": "wheel", "radius": 1.0}]}, "parts.0.wheel.radius: unknown key 'radius'; known: kind, rad"),
        ({"ends": [{"l": 1.0}, {}]}, "ends.0.l: unknown key 'l'; known: length_m (and"),
        ({"ends": [{"length_m": 1.0}, {"l": 1.0}]}, "ends.1.l: unknown key 'l'; known: kind, radius_m (and"),
        ({"either": {"x": 1.0}}, "either.Axle.x: unknown key 'x'; known: length_m (and"),
        ({"named": {"a": {"x": 1.0}}}, "named.a.x: unknown key 'x'; known: length_m (and"),
        ({"on": {"kin": "rail"}}, "on.kin: unknown key 'kin'; known: gauge_m, kind, radius_m"),
        (
            {"parts": [{"kind": "wheel", "radius_m": 1.0}, {"kinds": "rail"}]},
            "parts.1.kinds: unknown key 'kinds'",
        ),
        ({"on": 3}, "on: "),
        ({"wheels": 4}, "wheels: unknown key 'wheels'; known: either, ends, named, on, parts"),
    ],
)
def test_an_unknown_key_names_those_that_are_known_there(data: dict[str, Any], sentence: str) -> None:
    """Where a value may be of several types, the keys are those of the one that was chosen or tried."""
    with pytest.raises(ConfigError) as caught:
        config.build(Cart, data, "file")
    assert str(caught.value).startswith(f"file: {sentence}")


def test_a_merged_key_may_be_given_again(tmp_path: Path) -> None:
    text = "base: &base {core: 1, nice: 2}\nother: &other {<<: *base, core: 3}\nlast: {<<: *other, nice: 4}"
    data = config.read_yaml(write(tmp_path, text))
    assert (data["other"], data["last"]) == ({"core": 3, "nice": 2}, {"core": 3, "nice": 4})


@pytest.mark.parametrize(
    "rest",
    [
        "supervisor: {mode: attach, web: {port: 8081}}",
        "supervisor: {web: {port: 8081}}\nprocesses: {visualization: {enabled: false}}",
        "supervisor: {web: {port: 8081}}\nvisualization: {viewer: native}",
    ],
)
def test_containers_and_a_window_take_no_port_of_the_page(tmp_path: Path, rest: str) -> None:
    rig = config.load(Rig, write(tmp_path, f"name: r\n{rest}"))[0]
    assert rig.supervisor.web.port == rig.visualization.port == 8081


def test_any_free_port_may_be_asked_for_twice(tmp_path: Path) -> None:
    rig = config.load(Rig, write(tmp_path, "name: r\nvisualization: {port: 0}\nsupervisor: {web: {port: 0}}"))[0]
    assert rig.supervisor.web.port == rig.visualization.port == 0


def test_a_folder_of_configurations_that_is_not_there_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("TROCAR_CONFIG_DIR", str(tmp_path / "none"))
    with pytest.raises(ConfigError, match=r"^TROCAR_CONFIG_DIR: .*none: there is no such folder$"):
        config.config_directory()


def test_options_win_over_the_file_and_origins_are_known(tmp_path: Path) -> None:
    file = write(tmp_path, "name: a\nprocesses: {physics: {core: 1, priority: 60}}")
    rig, origins = config.load(Rig, file, ["processes.physics.core=0", "visualization.port=9000"])
    assert rig.process("physics").core == 0
    assert rig.process("physics").priority == 60
    assert rig.visualization.port == 9000
    assert origins["processes.physics.core"] == "--set"
    assert origins["processes.physics.priority"] == str(file)
    assert "visualization.host" not in origins


@pytest.mark.parametrize("text", ["3e-4", "3E-4", "0.3e-3", "+.3e-3"])
def test_a_float_with_an_exponent_is_one_whether_it_has_a_point_or_not(tmp_path: Path, text: str) -> None:
    assert config.read_yaml(write(tmp_path, f"film_m: {text}")) == {"film_m": 3e-4}
    data: dict[str, object] = {}
    config.apply_overrides(data, [f"film_m={text}"], {})
    assert data == {"film_m": 3e-4}


@pytest.mark.parametrize("text", ["e4", "3e", "1e5m", "0x1e5", "2026-01-01"])
def test_what_only_looks_like_a_float_is_none(tmp_path: Path, text: str) -> None:
    assert not isinstance(config.read_yaml(write(tmp_path, f"name: {text}"))["name"], float)


@pytest.mark.parametrize(
    ("text", "value"),
    [("012", 12), ("0o12", 10), ("0x1F", 31), ("-007", -7), ("1:30", "1:30"), ("1_000", "1_000"), ("-.inf", -math.inf)],
)
def test_a_number_is_what_a_person_takes_it_for(tmp_path: Path, text: str, value: object) -> None:
    """In YAML 1.1, which PyYAML reads, 012 is ten, 1:30 ninety and 1_000 a thousand."""
    assert config.read_yaml(write(tmp_path, f"n: {text}")) == {"n": value}


def test_a_file_without_an_end_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config.yaml_text, "LONGEST_TEXT", 1000)
    with pytest.raises(ConfigError, match=r"/dev/zero: has more than 1000 characters, that is no configuration"):
        config.read_yaml(Path("/dev/zero"))


def test_an_option_reaches_into_lists(tmp_path: Path) -> None:
    file = write(tmp_path, "name: a\ngateway: {instruments: [{name: left, port_m: [0, 0, 0], arm: {driver: x}}]}")
    rig, _ = config.load(Rig, file, ["gateway.instruments.0.arm.driver=phantom_simulated"])
    assert rig.gateway.instruments[0].arm.driver == "phantom_simulated"


@pytest.mark.parametrize("path", sorted((config.config_directory() / "rigs").glob("*.yaml")), ids=lambda p: p.stem)
def test_every_rig_file_of_the_repository_loads(path: Path) -> None:
    assert config.load_rig(path).name


def test_a_rig_on_a_base_says_only_what_differs(tmp_path: Path) -> None:
    (tmp_path / "below.yaml").write_text(
        "name: below\nvisualization: {port: 9000, rate_hz: 40}\nsupervisor: {backoff_s: [1.0, 2.0]}\n"
    )
    file = tmp_path / "above.yaml"
    file.write_text("name: above\nbase: below\nvisualization: {rate_hz: 50}\nsupervisor: {backoff_s: [3.0]}\n")
    rig, origins = config.load(Rig, file, ["scene=pinch"])
    assert (rig.name, rig.scene, rig.visualization.port, rig.visualization.rate_hz) == ("above", "pinch", 9000, 50)
    assert rig.supervisor.backoff_s == (3.0,), "lists are replaced"
    assert origins["visualization.port"].endswith("below.yaml")
    assert origins["visualization.rate_hz"].endswith("above.yaml")


def test_a_base_of_the_rigs_that_come_with_it_and_a_base_of_a_base(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text("name: one\nbase: stub\n")
    rig = config.load_rig(write(tmp_path, "name: two\nbase: one\n"))
    stub = config.load_rig("stub")
    assert rig.model_copy(update={"name": "stub", "base": None}) == stub


def test_an_instrument_takes_what_is_not_said_of_it_from_the_one_of_its_name_below(tmp_path: Path) -> None:
    below, right = (
        config.load_rig("mouse").gateway,
        "{name: right, port_m: [0, 0, 0.2], grasp: {settings: {shut_rad: 0.3}}}",
    )
    rig = config.load_rig(
        write(
            tmp_path,
            f"name: mine\nbase: mouse\ngateway: {{instruments: [{right}, {{name: left, arm: {{driver: gamepad}}}}]}}\n",
        )
    )
    first, second = rig.gateway.instruments
    assert (first.name, first.port_m, first.mount) == ("right", (0.0, 0.0, 0.2), below.instruments[1].mount)
    assert first.grasp is not None
    assert (first.grasp.driver, first.grasp.settings) == ("grasp_web", {"shut_rad": 0.3}), "settings are replaced"
    assert (second.arm.driver, second.arm.settings) == ("gamepad", below.instruments[0].arm.settings)
    assert second.grasp == below.instruments[0].grasp


def test_the_file_above_says_which_instruments_there_are(tmp_path: Path) -> None:
    rig = config.load_rig(write(tmp_path, "name: mine\nbase: mouse\ngateway: {instruments: [{name: right}]}\n"))
    assert rig.gateway.instruments == config.load_rig("mouse").gateway.instruments[1:]


def test_a_large_file_is_refused_by_its_size(tmp_path: Path) -> None:
    file = write(tmp_path, f"a: [{'1, ' * 5_600_000}1]")
    before_s = time.process_time()
    with pytest.raises(ConfigError, match=r"has more than 1e\+06 characters"):
        config.load_rig(file)
    assert time.process_time() - before_s < 1.0
