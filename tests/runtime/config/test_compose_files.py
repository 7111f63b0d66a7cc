"""What the compose files say of the loops, without an engine."""

from __future__ import annotations

import os
import re
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.measures.flight import FlightRing
from trocar.services.runtime.realtime.realtime import DMA_LATENCY

ROOT = Path(__file__).resolve().parents[3]


def _services(file: str) -> dict[str, dict[str, Any]]:
    """Return the rig's services: not what looks at it."""
    services: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / file).read_text("utf-8"))["services"]
    return {name: each for name, each in services.items() if "monitoring" not in each.get("profiles", ())}


def test_what_the_hand_feels_comes_before_what_else_the_host_computes() -> None:
    """Where no real-time class is granted, a niceness would count beside the other processes of its container only."""
    weights = {name: each.get("cpu_shares", 1024) for name, each in _services("docker-compose.yml").items()}
    loops = {weights[name] for name in ("physics", "haptics", "gateway", "gateway-hardware", "supervisor")}
    assert min(loops) > weights["recorder"] > weights["visualization"]


def test_who_computes_is_not_root_and_writes_volumes_only() -> None:
    """What begins as root lets go of it in as-trocar, and keeps the two rights that a loop needs."""
    image = (ROOT / "deploy" / "Dockerfile").read_text("utf-8")
    assert image.rindex("USER trocar") > image.rindex("COPY")
    assert 'ENTRYPOINT ["as-trocar", ' in image
    kept = re.search(r"^keep=(\S+)$", (ROOT / "deploy" / "as-trocar").read_text("utf-8"), re.MULTILINE)
    assert kept is not None
    assert kept[1] == "+sys_nice,+ipc_lock"
    for name, each in _services("docker-compose.yml").items():
        assert each["read_only"] is True, name
        assert each["cap_drop"] == ["ALL"], name
        assert each["security_opt"] == ["no-new-privileges:true"], name
        assert ("user" in each) is ("SYS_NICE" in each.get("cap_add", [])), name


def test_every_container_says_whether_it_is_well_and_has_limits_that_a_host_may_change() -> None:
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text("utf-8"))["services"]
    for name, each in services.items():
        assert each["healthcheck"]["test"][0] == "CMD", name
        assert re.fullmatch(r"\$\{\w+:-\d+[mg]\}", each["mem_limit"]), name
        ports = each.get("ports", [])
        assert all(re.fullmatch(r"127\.0\.0\.1:\$\{\w+:-\d+\}:\d+", port) for port in ports), name
    for name, each in _services("docker-compose.yml").items():
        assert re.fullmatch(r"\$\{\w+:-\d+\}", each["pids_limit"]), name


def test_the_rig_of_the_containers_may_be_open_within_because_nobody_outside_reaches_it() -> None:
    """Without the word of the compose file it would be refused: its servers bind every address of their containers."""
    services = _services("docker-compose.yml")
    overrides = tuple(services["supervisor"]["environment"]["TROCAR_SET"].split())
    config.load_rig("stub", overrides)
    with pytest.raises(ConfigError, match="over the network in clear"):
        config.load_rig("stub", tuple(each for each in overrides if "insecure" not in each))
    assert {name for name, each in services.items() if "ports" in each} == {"supervisor", "visualization"}


def test_every_container_of_the_rig_is_looked_at_by_its_own_ring() -> None:
    for name, each in _services("docker-compose.yml").items():
        assert each["healthcheck"]["test"] == ["CMD", "as-trocar", "--check", name.partition("-")[0]]


@pytest.mark.parametrize(
    ("shared", "ticks", "exit_code", "said"),
    [
        (False, False, 1, "physics: not ready yet\n"),
        (True, False, 1, "physics: no tick in a second\n"),
        (True, True, 0, ""),
    ],
)
def test_a_container_is_well_while_its_loop_ticks_and_a_look_starts_no_python(
    tmp_path: Path, shared: bool, ticks: bool, exit_code: int, said: str
) -> None:
    """A look that started Python cost half a second: of all containers at once it held up a start by ten seconds."""
    (tmp_path / "python").write_text("#!/bin/sh\necho python was started\n")
    (tmp_path / "python").chmod(0o755)
    ring = FlightRing(1000.0)
    if shared:
        ring.share(tmp_path / "physics.flight")
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "TROCAR_AS_ROOT": "1", "TROCAR_RINGS": str(tmp_path)}
    look = subprocess.Popen(
        ["sh", ROOT / "deploy" / "as-trocar", "--check", "physics"],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while look.poll() is None:
        if ticks:
            ring.write(0, 0, 0, 0, 0, ())
        time.sleep(0.01)
    assert (look.returncode, *look.communicate()) == (exit_code, "", said)


def test_the_rig_starts_on_a_host_without_the_device() -> None:
    devices = [device for each in _services("docker-compose.yml").values() for device in each.get("devices", [])]
    assert not any(str(DMA_LATENCY) in device for device in devices)


def test_beside_the_other_file_each_loop_gets_the_device_and_nothing_else() -> None:
    rig, awake = _services("docker-compose.yml"), _services("deploy/compose.awake.yml")
    loops = {name for name in rig if name.partition("-")[0] in ("physics", "haptics", "gateway")}
    assert awake.keys() == loops
    assert all(each == {"devices": [str(DMA_LATENCY)]} for each in awake.values())


def test_only_one_container_fills_a_new_cache_from_the_image() -> None:
    """The engine copies for each container that may, at once: one found the folders of another, and `up` ended."""
    mounts = {name: each["volumes"] for name, each in _services("docker-compose.yml").items()}
    caches = {name: next(mount for mount in some if mount.startswith("cache:")) for name, some in mounts.items()}
    assert [name for name, mount in caches.items() if not mount.endswith(":nocopy")] == ["physics"]
