"""Findings and their exit code; probes that crash or hang are findings, not crashes."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from tests.docs.reference import ROOT
from tests.docs.test_pages import anchors
from trocar.services.cli import host_checks, probes
from trocar.services.cli.delay_checks import delay
from trocar.services.cli.host_checks import CheckResult, Verdict
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.hdapi import host_checks as arms
from trocar.services.runtime.config import config


@pytest.fixture
def no_probes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probes, "graphics", lambda: [CheckResult("picture", Verdict.WARN, "it is black", "[advice]")])


@pytest.mark.usefixtures("no_probes")
def test_warnings_are_not_failures(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("doctor", "--rig", rig_file, "--json")
    assert ran.code == 0
    shown = json.loads(ran.out)
    assert shown["ok"]
    names = {check["name"] for check in shown["checks"]}
    assert names >= {
        "python",
        "packages",
        "web page",
        "cores",
        "scheduling class",
        "memlock",
        "cache folder",
        "picture",
    }
    assert all(check["advice"] for check in shown["checks"] if check["verdict"] != "ok")


@pytest.mark.usefixtures("no_probes")
def test_what_is_needed_and_missing_is_a_failure(
    trocar: Trocar, rig_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_checks, "_NEEDED", ("numpy", "no_such_package"))
    ran = trocar("doctor", "--rig", rig_file)
    assert ran.code == 1
    assert "missing: no_such_package" in ran.out
    assert "[advice]" in ran.out


@pytest.mark.usefixtures("no_probes")
def test_the_devices_of_the_rig_are_looked_for(trocar: Trocar, rig_file: Path) -> None:
    arm = "{driver: phantom_hdapi, device: touch, settings: {library: libHD-that-nobody-has.so}}"
    checks = _failing_checks_of(arm, trocar, rig_file)
    assert checks["OpenHaptics"]["verdict"] == "fail"
    assert "libHD-that-nobody-has.so" in checks["OpenHaptics"]["found"]
    assert "TouchDriver" in checks["OpenHaptics"]["advice"]


@pytest.mark.usefixtures("no_probes")
def test_a_rig_that_up_refuses_is_a_failure(trocar: Trocar, rig_file: Path) -> None:
    checks = _failing_checks_of("{driver: phantom_simulated, device: nope}", trocar, rig_file)
    assert checks["configuration"]["verdict"] == "fail"
    assert "no device 'nope'" in checks["configuration"]["found"]


def _failing_checks_of(arm: str, trocar: Trocar, rig_file: Path) -> dict[str, dict[str, str]]:
    """Return the checks of a rig with this arm, by name, with which doctor must end in 1."""
    instrument = f"{{name: left, port_m: [0.0, 0.0, 0.1], arm: {arm}}}"
    rig_file.write_text(f"{rig_file.read_text()}gateway: {{instruments: [{instrument}]}}\n")
    ran = trocar("doctor", "--rig", rig_file, "--json")
    assert ran.code == 1
    return {check["name"]: check for check in json.loads(ran.out)["checks"]}


_ANCHOR = re.compile(r"(docs/how-to/deployment\.md)#([\w-]+)")


def test_what_the_host_lacks_leads_to_a_heading_of_the_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing(name: str, ok: bool, found: str, advice: str, *, needed: bool = False) -> CheckResult:
        return CheckResult(name, Verdict.FAIL, found, advice)

    monkeypatch.setattr(host_checks, "finding", missing)
    advice = {check.name: check.advice for check in host_checks.scheduling() if check.verdict is not Verdict.OK}
    assert advice.keys() >= {"cores", "scheduling class", "memlock", "preemption", "idle cores"}
    arm = tmp_path / "sys/bus/usb/devices/1-1"
    arm.mkdir(parents=True)
    (arm / "idVendor").write_text("2988\n")
    advice |= {check.name: check.advice for check in arms.check(["left"], "libHD-that-nobody-has.so", False, tmp_path)
               if check.name == "arms' permissions"}  # fmt: skip
    told = {name: _ANCHOR.search(text) for name, text in advice.items()}
    assert "arms' permissions" in told
    for name, found in told.items():
        assert found, f"{name} names no heading"
        assert found[2] in anchors(ROOT / found[1]), f"{name}: there is no heading {found[2]}"


def _probe(script: str, patience_s: float = 120.0) -> CheckResult:
    return probes.probe("picture", script, patience_s, {}, "advice")


def test_a_probe_that_crashes() -> None:
    found = _probe(f"import os; os.kill(os.getpid(), {int(signal.SIGSEGV)})")
    assert (found.verdict, found.found) == (Verdict.WARN, "crashes with SIGSEGV")


def test_a_probe_that_hangs() -> None:
    assert _probe("import time; time.sleep(60)", 0.3).found.startswith("no answer within")


def test_a_probe_that_fails_says_its_last_line() -> None:
    assert _probe("raise SystemExit('the picture is black')").found == "the picture is black"


def test_a_folder_that_does_not_exist_yet_is_judged_by_the_one_above(tmp_path: Path) -> None:
    found = host_checks._folder("recordings", tmp_path / "a" / "b", shared=False)
    assert found.verdict is Verdict.OK
    (tmp_path / "a").touch()
    found = host_checks._folder("recordings", tmp_path / "a" / "b", shared=False)
    assert (found.verdict, found.found.endswith(f"free, {tmp_path / 'a'} is a file, not a folder")) == (
        Verdict.WARN, True,
    )  # fmt: skip


@pytest.mark.usefixtures("no_probes")
def test_what_device_files_assume_of_delay_and_friction_is_shown(trocar: Trocar, rig_file: Path) -> None:
    arm = "{driver: phantom_simulated, device: touch}"
    instrument = f"{{name: left, port_m: [0.0, 0.0, 0.1], arm: {arm}}}"
    rig_file.write_text(f"{rig_file.read_text()}gateway: {{instruments: [{instrument}]}}\n")
    checks = json.loads(trocar("doctor", "--rig", rig_file, "--json").out)["checks"]
    found = next(check["found"] for check in checks if check["name"] == "delay of left arm")
    assert found == (
        "interface assumed to take at most 1 ms, not measured, as no rig runs; "
        "friction of 0.065 N relied on, 25% of 0.26 N"
    )


def test_a_measured_delay_stands_beside_the_assumed_one_and_both_together_may_be_too_long() -> None:
    file = config.load(ArmFile, config.find("device", "touch"))[0]
    short, long = (delay("left arm", file, span_s) for span_s in (0.125e-3, 4.5e-3))
    assert short.verdict is Verdict.OK
    assert "at most 1 ms, measured 0.125 ms beside it" in short.found
    assert long.verdict is Verdict.WARN
    assert "later than 5 ms in all fade" in long.advice
