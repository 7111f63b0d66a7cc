"""Rig files and options of a rig that are refused: one table of what is written, and of the sentence about it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.refusals import assert_refused
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import ConfigError

_ARM = "{name: left, port_m: [0.0, 0.0, 0.1], arm: {driver: phantom_simulated}}"
_MANY = "\n".join(
    ["a0: &a0 [x, x, x, x, x, x, x, x, x]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9))]
)
_INSTRUMENTS = "name: mine\nbase: mouse\ngateway: {{instruments: {}}}"

#: The file's text, and a pattern of the sentence.
FILES = [
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
    # Gauges of two arms of one name were one; of two servers on one port the second could not begin.
    (
        f"name: r\ngateway: {{instruments: [{_ARM}, {_ARM}]}}",
        "gateway.instruments: two instruments are called 'left'",
    ),
    ("name: r\nvisualization: {port: 8080}", r"visualization.port: 8080 is the page's already"),
    # Values that mean nothing, with unit and reason.
    ("name: a\nsupervisor: {backoff_s: []}", re.escape("supervisor.backoff_s: is empty")),
    (
        "name: a\nsupervisor: {backoff_s: [1.0e+12]}",
        re.escape("1e+12 s is more than 60 s: what fails has to be noticed"),
    ),
    (
        "name: a\nsupervisor: {heartbeat_timeout_s: 1.0e+12}",
        re.escape("heartbeat_timeout_s: 1e+12 s is more than 60 s: "),
    ),
    (
        "name: a\nsupervisor: {ready_timeout_s: 1.0e+12}",
        re.escape("ready_timeout_s: 1e+12 s is more than 86400 s: nobody waits"),
    ),
    (
        "name: a\ngateway: {supervisor_timeout_s: 1.0e+12}",
        re.escape("supervisor_timeout_s: 1e+12 s is more than 60 s: "),
    ),
    ("name: a\ngateway: {instruments: []}", re.escape("gateway.instruments: is empty")),
    (
        "name: a\ngateway: {grasp_torque_limit_nm: 1000.0}",
        re.escape("grasp_torque_limit_nm: 1000 N m is more than 5 N m: the servo"),
    ),
    ("name: a\ngateway: {force_limit_n: -1.0}", re.escape("force_limit_n: -1 N is less than 0.01 N: no instrument")),
    (
        "name: a\ngateway: {force_limit_n: 1.0e+12}",
        re.escape("force_limit_n: 1e+12 N is more than 20 N: no instrument"),
    ),
    (
        "name: a\nsupervisor: {window_s: 1.0e+12}",
        re.escape("window_s: 1e+12 s is more than 60 s: a mean has to follow"),
    ),
    (
        "name: a\nsupervisor: {max_restarts_per_minute: 1000000000000}",
        re.escape("1000000000000 is more than 600: no process starts"),
    ),
    (
        "name: a\nrecorder: {sample_rate_hz: 1.0e+12}",
        re.escape("sample_rate_hz: 1e+12 Hz is more than 200 Hz: for more name"),
    ),
    ("name: a\nvisualization: {rate_hz: 0.0}", re.escape("visualization.rate_hz: 0 Hz is less than 10 Hz: a screen")),
    (
        "name: a\ncontracts: {loops: {gateway: {rate_hz: 1.0e-300}}}",
        re.escape("rate_hz: 1e-300 Hz is less than 0.1 Hz: no loop"),
    ),
    (
        "name: a\nprocesses: {physics: {core: 1000}}",
        re.escape("processes.physics.core: 1000 is more than 511: no host of a rig"),
    ),
    (
        "name: a\nsupervisor: {backoff_s: [-1.0]}",
        r"rig.yaml: supervisor.backoff_s.0: -.* s is less than 0 s: what fails",
    ),
    # What YAML lets a person write.
    (_MANY, r"rig.yaml: aliases stand for more than 1e\+06 values"),
    *(
        (f"gateway: &a {text}", r"rig.yaml: an alias stands for what it is a part of")
        for text in ("{instruments: *a}", "[1, *a]")
    ),
    ("n: " + "9" * 400, r"rig.yaml: line 1, column 4: '9{40}' is no value of int"),
    # Half a character was called bad JSON at a column of a text that nobody had written; an escape cleared screens.
    *(
        (f'base: stub\nname: "a{written}b"', r"rig.yaml: line 2, column 7: a text holds the character U\+[0-9A-F]{4},")
        for written in ("\\uD800", "\\0", "\\e[2J")
    ),
    # What leads elsewhere than a person means.
    *(
        (f"name: {name}", r"rig.yaml: name: recordings are called after it")
        for name in ("../../evil", "a/b", '"a\\nb"', ".hidden")
    ),
    *(
        (
            f'name: a\n{above}: {{{below}: ""}}',
            rf"rig.yaml: {above}.{below}: is empty; the present folder is called '.'",
        )
        for above, below in (("transport", "directory"), ("transport", "keys"), ("recorder", "directory"))
    ),
    *(
        (_INSTRUMENTS.format(names), r"gateway\.instruments\.0")
        for names in ("[{name: [1]}]", "[{port_m: [0, 0, 0]}]", "[3]")
    ),
    ("name: mine\nbase: nowhere", r"rig\.yaml: base: there is no rig 'nowhere' in .*; known: .*stub"),
    ("name: mine\nbase: nowhere.yaml", r"rig\.yaml: base: nowhere\.yaml: there is no such rig file"),
    ("name: mine\nbase: rig", r"rig\.yaml: base: the file is, by way of others, its own base"),
    ("name: mine\nbase: [stub]", r"rig\.yaml: base: must be the name of a rig"),
    ("name: mine\nbase: stub\ncolour: red", r"rig\.yaml on stub: colour: unknown key"),
]

_ADDRESSES = ("supervisor.web.host", "visualization.host", "transport.host", "transport.bind_host")

#: An option after ``--set``, and a pattern of the sentence.
OPTIONS = [
    *(
        (option, r"--set")
        for option in (
            "nonsense",
            "=3",
            "name.deeper=1",
            "gateway.instruments.7.name=x",
            "gateway.instruments.-1.name=x",
            "gateway.instruments.0x0.name=x",
        )
    ),
    ("processes.physics={core: 1, core: 2}", r"is not a YAML value: key 'core' is given twice"),
    ("base=hardware", r"name that rig file instead"),
    # Bound to "", a page is there for the whole network.
    *(
        (f"{key}='{empty}'", rf"{key}: is empty; all addresses of this host are called 0\.0\.0\.0")
        for key in _ADDRESSES
        for empty in ("", " ")
    ),
]

#: A rig's name, or the path of its file, and a pattern of the sentence.
NAMES = [
    ("nonsense", r"there is no rig 'nonsense' in .*configs/rigs; known: .*stub"),
    ("nowhere.yaml", r"nowhere.yaml: there is no such rig file"),
    # Of a path that no file can have Python 3.14 says that there is none, and earlier ones what the system says.
    ("a" * 300, r"aaa\.yaml: File name too long$|^there is no rig 'aaa.*; known: "),
    (f"{'a' * 300}.yaml", r"aaa\.yaml: File name too long$|aaa\.yaml: there is no such rig file$"),
]


@pytest.mark.parametrize(("text", "sentence"), FILES)
def test_a_mistake_in_a_rig_file_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    assert_refused(config.load_rig, tmp_path / "rig.yaml", text, sentence)


@pytest.mark.parametrize(("option", "sentence"), OPTIONS)
def test_a_mistake_in_an_option_is_one_sentence(option: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence) as caught:
        config.load(Rig, config.find("rig", "stub"), [option])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "sentence"), NAMES)
def test_a_rig_that_is_not_there_is_one_sentence(name: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        config.load_rig(name)
