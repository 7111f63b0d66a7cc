"""Configuration: typed, origins known, and every mistake one sentence that names file and key."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from trocar.services.gateway.devices.device_files import DeviceFile
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig, Settings
from trocar.services.runtime.errors import ConfigError


def write(path: Path, text: str) -> Path:
    file = path / "rig.yaml"
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("name: [unclosed", r"rig.yaml: line 1, column \d+: "),
        ("- a\n- b", r"rig.yaml: the file must be a mapping"),
        ("{}", r"rig.yaml: name: this key is missing"),
        ("name: a\ncolour: red", r"rig.yaml: colour: unknown key 'colour'; known: base, contracts, gateway, name, "),
        (
            "name: a\nprocesses: {physics: {coer: 1}}",
            r"processes.physics.coer: unknown key 'coer'; known: core, critical, enabled, nice, ",
        ),
        (
            "name: a\nprocesses: {physic: {core: 1}}",
            r"processes.physic: there is no process 'physic'; known: .*physics",
        ),
        (
            "name: a\ncontracts: {loops: {gatway: {rate_hz: 1.0, miss_ratio: 0.1}}}",
            r"contracts.loops.gatway: there is no process 'gatway'; known",
        ),
        (
            "name: a\ncontracts: {paths: {device_modle: {p99_us: 800.0}}}",
            r"contracts.paths.device_modle: there is no path 'device_modle'; known: servo, grasp, device_model, ",
        ),
        (
            "name: a\nprocesses: {physics: {priority: 99}}",
            r"processes.physics.priority: 99 is more than 89: SCHED_FIFO",
        ),
        ("name: a\nprocesses: {physics: {core: '1'}}", r"processes.physics.core: input should be a valid integer"),
        ("name: a\ngateway: {force_limit_n: .nan}", r"gateway.force_limit_n: input should be a finite number"),
        ("name: a\nvisualization: {rate_hz: '30'}", r"visualization.rate_hz: input should be a valid number"),
        ("name: a\ntransport: {kind: pigeon}", r"transport.kind: input should be 'ipc' or 'tcp'"),
        (
            "name: a\ngateway: {instruments: [{name: left, port_m: [0, 0, 0], arm: {drver: x}}]}",
            r"gateway.instruments.0.arm.drver: unknown key 'drver'; known: device, driver, settings \(and 1 more\)",
        ),
        ("name: a\ntransport: {kind: tcp, bind_host: 0.0.0.0}", r"transport: tcp to 0.0.0.0 leaves this host"),
        (
            "name: a\nrecorder: {whole: [gateway.coffee]}",
            r"recorder.whole: the recorder does not read 'gateway.coffee'; known: .*gateway.state",
        ),
        ("name: a\n2026-01-01: b", r"rig.yaml: keys must be str"),
        ("name: 2026-13-45", r"rig.yaml: line 1, column 7: '2026-13-45' is no value of timestamp"),
        ("name: !!float soft", r"rig.yaml: line 1, column 7: 'soft' is no value of float"),
        ("name: !!bool perhaps", r"rig.yaml: line 1, column 7: 'perhaps' is no value of bool"),
        ("name: !!timestamp now", r"rig.yaml: line 1, column 7: 'now' is no value of timestamp"),
        (f"name: {'9' * 5000}", r"rig.yaml: line 1, column 7: '9{40}' is no value of int"),
        (f"name: {'[' * 3000}", r"rig.yaml: brackets are nested too deeply"),
        ("name: a\nname: b", r"rig.yaml: line 2, column 1: key 'name' is given twice, first in line 1"),
        (
            "name: a\nprocesses:\n  physics: {core: 1,\n    core: 2}",
            r"rig.yaml: line 4, column 5: key 'core' is given twice, first in line 3",
        ),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence) as caught:
        config.load(Rig, write(tmp_path, text))
    assert "\n" not in str(caught.value)


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
        ({"wheels": 4}, "wheels: unknown key 'wheels'; known: either, ends, named, on, parts"),
    ],
)
def test_an_unknown_key_names_those_that_are_known_there(data: dict[str, Any], sentence: str) -> None:
    """Where a value may be of several types, the keys are those of the one that was chosen or tried."""
    with pytest.raises(ConfigError) as caught:
        config.build(Cart, data, "file")
    assert str(caught.value).startswith(f"file: {sentence}")


def test_what_decides_which_keys_there_are_is_missed_by_its_name() -> None:
    with pytest.raises(ConfigError, match=r"^a.yaml: kind: this key is missing"):
        config.build(DeviceFile, {"model": "x"}, "a.yaml")


@pytest.mark.parametrize(
    ("kind", "data", "sentence"),
    [
        (DeviceFile, {"kidn": "arm", "model": "x"}, "kidn: unknown key 'kidn'; known: "),
        (Cart, {"on": {"kin": "rail"}}, "on.kin: unknown key 'kin'; known: gauge_m, kind, radius_m"),
        (
            Cart,
            {"parts": [{"kind": "wheel", "radius_m": 1.0}, {"kinds": "rail"}]},
            "parts.1.kinds: unknown key 'kinds'",
        ),
        (Cart, {"on": 3}, "on: "),
    ],
)
def test_what_decides_is_misspelt(kind: type[Any], data: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        config.build(kind, data, "file")
    assert str(caught.value).startswith(f"file: {sentence}")


def test_an_option_that_is_no_yaml_says_why(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"is not a YAML value: key 'core' is given twice"):
        config.load(Rig, write(tmp_path, "name: a"), ["processes.physics={core: 1, core: 2}"])


def test_of_a_file_that_may_be_two_things_too() -> None:
    with pytest.raises(
        ConfigError,
        match=r"arm.modle: unknown key 'modle'; known: continuous_force_n, count_m, device_centre_m, friction_n",
    ):
        config.build(DeviceFile, {"kind": "arm", "modle": "x"}, "file")


def test_a_merged_key_may_be_given_again(tmp_path: Path) -> None:
    text = "base: &base {core: 1, nice: 2}\nother: &other {<<: *base, core: 3}\nlast: {<<: *other, nice: 4}"
    data = config.read_yaml(write(tmp_path, text))
    assert (data["other"], data["last"]) == ({"core": 3, "nice": 2}, {"core": 3, "nice": 4})


ARM = "{name: left, port_m: [0.0, 0.0, 0.1], arm: {driver: phantom_simulated}}"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            f"name: r\ngateway: {{instruments: [{ARM}, {ARM}]}}",
            "gateway.instruments: two instruments are called 'left'",
        ),
        ("name: r\nvisualization: {port: 8080}", r"visualization.port: 8080 is the page's already"),
    ],
)
def test_what_would_hide_or_shut_out_another_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    """Gauges of two arms of one name were one; of two servers on one port the second could not begin."""
    with pytest.raises(ConfigError, match=sentence):
        config.load(Rig, write(tmp_path, text))


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


def test_a_file_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(ConfigError, match=r"there is no rig 'nonsense' in .*configs/rigs; known: .*stub"):
        config.load_rig("nonsense")
    with pytest.raises(ConfigError, match=r"nowhere.yaml: there is no such rig file"):
        config.load_rig("nowhere.yaml")


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


def test_aliases_of_aliases_are_refused_before_they_are_written_out(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    with pytest.raises(ConfigError, match=r"rig.yaml: aliases stand for more than 1e\+06 values"):
        config.load_rig(write(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize("text", ["gateway: &a {instruments: *a}", "gateway: &a [1, *a]"])
def test_an_alias_within_itself_is_one_sentence(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r"rig.yaml: an alias stands for what it is a part of"):
        config.load_rig(write(tmp_path, text))


@pytest.mark.parametrize("written", ["\\uD800", "\\0", "\\e[2J"])
def test_a_character_that_no_text_has_is_told_with_its_place(tmp_path: Path, written: str) -> None:
    """Half a character was called bad JSON at a column of a text that nobody had written; an escape cleared screens."""
    with pytest.raises(ConfigError, match=r"rig.yaml: line 2, column 7: a text holds the character U\+[0-9A-F]{4},"):
        config.load_rig(write(tmp_path, f'base: stub\nname: "a{written}b"'))


def test_a_whole_number_beyond_the_machine_s_is_told_with_its_place(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"rig.yaml: line 1, column 4: '9{40}' is no value of int"):
        config.read_yaml(write(tmp_path, "n: " + "9" * 400))


def test_a_file_without_an_end_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config.yaml_text, "LONGEST_TEXT", 1000)
    with pytest.raises(ConfigError, match=r"/dev/zero: has more than 1000 characters, that is no configuration"):
        config.read_yaml(Path("/dev/zero"))


@pytest.mark.parametrize("name", ["../../evil", "a/b", '"a\\nb"', ".hidden"])
def test_a_rig_s_name_cannot_lead_out_of_the_folder_of_its_recordings(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"rig.yaml: name: recordings are called after it"):
        config.load_rig(write(tmp_path, f"name: {name}"))


@pytest.mark.parametrize("key", ["transport.directory", "transport.keys", "recorder.directory"])
def test_a_path_that_is_empty_is_not_the_present_folder(tmp_path: Path, key: str) -> None:
    above, _, below = key.partition(".")
    with pytest.raises(ConfigError, match=rf"rig.yaml: {above}.{below}: is empty; the present folder is called '.'"):
        config.load_rig(write(tmp_path, f'name: a\n{above}: {{{below}: ""}}'))


def test_a_wait_before_a_restart_is_not_negative(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"rig.yaml: supervisor.backoff_s.0: -.* s is less than 0 s: what fails"):
        config.load_rig(write(tmp_path, "name: a\nsupervisor: {backoff_s: [-1.0]}"))


def test_a_name_that_no_file_can_have_is_one_sentence() -> None:
    """Python 3.14 says of such a path that there is no such file, and earlier ones what the system says."""
    sentence = r"aaa\.yaml: File name too long$|^there is no rig 'aaa.*; known: |aaa\.yaml: there is no such rig file$"
    for name in ("a" * 300, f"{'a' * 300}.yaml"):
        with pytest.raises(ConfigError, match=sentence):
            config.load_rig(name)


def test_an_option_reaches_into_lists(tmp_path: Path) -> None:
    file = write(tmp_path, "name: a\ngateway: {instruments: [{name: left, port_m: [0, 0, 0], arm: {driver: x}}]}")
    rig, _ = config.load(Rig, file, ["gateway.instruments.0.arm.driver=phantom_simulated"])
    assert rig.gateway.instruments[0].arm.driver == "phantom_simulated"


@pytest.mark.parametrize(
    "option",
    [
        "nonsense",
        "=3",
        "name.deeper=1",
        "gateway.instruments.7.name=x",
        "gateway.instruments.-1.name=x",
        "gateway.instruments.0x0.name=x",
    ],
)
def test_an_option_that_fits_nowhere_says_so(tmp_path: Path, option: str) -> None:
    file = write(tmp_path, "name: a\ngateway: {instruments: [{name: left, port_m: [0, 0, 0], arm: {driver: x}}]}")
    with pytest.raises(ConfigError, match=r"--set"):
        config.load(Rig, file, [option])


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


@pytest.mark.parametrize("names", ["[{name: [1]}]", "[{port_m: [0, 0, 0]}]", "[3]"])
def test_instruments_without_a_name_are_one_sentence(tmp_path: Path, names: str) -> None:
    with pytest.raises(ConfigError, match=r"gateway\.instruments\.0"):
        config.load_rig(write(tmp_path, f"name: mine\nbase: mouse\ngateway: {{instruments: {names}}}\n"))


@pytest.mark.parametrize(
    ("base", "sentence"),
    [
        ("nowhere", r"rig\.yaml: base: there is no rig 'nowhere' in .*; known: .*stub"),
        ("nowhere.yaml", r"rig\.yaml: base: nowhere\.yaml: there is no such rig file"),
        ("rig", r"rig\.yaml: base: the file is, by way of others, its own base"),
        ("[stub]", r"rig\.yaml: base: must be the name of a rig"),
        ("stub\ncolour: red", r"rig\.yaml on stub: colour: unknown key"),
    ],
)
def test_a_base_that_cannot_be_is_one_sentence(tmp_path: Path, base: str, sentence: str) -> None:
    (tmp_path / "rig.yaml").write_text(f"name: mine\nbase: {base}\n")
    with pytest.raises(ConfigError, match=sentence):
        config.load_rig(tmp_path / "rig.yaml")


def test_a_base_cannot_be_set_afterwards() -> None:
    with pytest.raises(ConfigError, match="name that rig file instead"):
        config.load_rig("stub", ["base=hardware"])


@pytest.mark.parametrize("key", ["supervisor.web.host", "visualization.host", "transport.host", "transport.bind_host"])
@pytest.mark.parametrize("empty", ["", " "])
def test_no_address_is_not_every_address(key: str, empty: str) -> None:
    """Bound to "", a page is there for the whole network."""
    with pytest.raises(ConfigError, match=rf"{key}: is empty; all addresses of this host are called 0\.0\.0\.0"):
        config.load_rig("stub", [f"{key}='{empty}'"])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("supervisor: {backoff_s: []}", "supervisor.backoff_s: is empty"),
        ("supervisor: {backoff_s: [1.0e+12]}", "1e+12 s is more than 60 s: what fails has to be noticed"),
        ("supervisor: {heartbeat_timeout_s: 1.0e+12}", "heartbeat_timeout_s: 1e+12 s is more than 60 s: "),
        ("supervisor: {ready_timeout_s: 1.0e+12}", "ready_timeout_s: 1e+12 s is more than 86400 s: nobody waits"),
        ("gateway: {supervisor_timeout_s: 1.0e+12}", "supervisor_timeout_s: 1e+12 s is more than 60 s: "),
        ("gateway: {instruments: []}", "gateway.instruments: is empty"),
        ("gateway: {grasp_torque_limit_nm: 1000.0}", "grasp_torque_limit_nm: 1000 N m is more than 5 N m: the servo"),
        ("gateway: {force_limit_n: -1.0}", "force_limit_n: -1 N is less than 0.01 N: no instrument"),
        ("gateway: {force_limit_n: 1.0e+12}", "force_limit_n: 1e+12 N is more than 20 N: no instrument"),
        ("supervisor: {window_s: 1.0e+12}", "window_s: 1e+12 s is more than 60 s: a mean has to follow"),
        ("supervisor: {max_restarts_per_minute: 1000000000000}", "1000000000000 is more than 600: no process starts"),
        ("recorder: {sample_rate_hz: 1.0e+12}", "sample_rate_hz: 1e+12 Hz is more than 200 Hz: for more name"),
        ("visualization: {rate_hz: 0.0}", "visualization.rate_hz: 0 Hz is less than 10 Hz: a screen"),
        ("contracts: {loops: {gateway: {rate_hz: 1.0e-300}}}", "rate_hz: 1e-300 Hz is less than 0.1 Hz: no loop"),
        ("processes: {physics: {core: 1000}}", "processes.physics.core: 1000 is more than 511: no host of a rig"),
    ],
)
def test_a_value_that_means_nothing_is_refused_with_unit_and_reason(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as refused:
        config.load_rig(write(tmp_path, f"name: a\n{text}"))
    assert sentence in str(refused.value)


def test_a_large_file_is_refused_by_its_size(tmp_path: Path) -> None:
    file = write(tmp_path, f"a: [{'1, ' * 5_600_000}1]")
    before_s = time.process_time()
    with pytest.raises(ConfigError, match=r"has more than 1e\+06 characters"):
        config.load_rig(file)
    assert time.process_time() - before_s < 1.0
