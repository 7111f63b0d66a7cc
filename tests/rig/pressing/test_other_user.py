"""Another user of the machine beside a running rig: reads nothing, moves nothing, stops nothing."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from pathlib import Path

import pytest

from tests.other_user import as_other_user, needs_other_user
from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig
from tests.rig.faults import drives_of
from trocar.services.runtime.measures.flight import flight_directory

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600), needs_other_user]

_ATTACK = """
import json, os, signal, socket, sys, urllib.error, urllib.request
files, sockets, pids, page = json.loads(sys.argv[1])
def connect(path):
    socket.socket(socket.AF_UNIX).connect(path)
def command(name):
    urllib.request.urlopen(urllib.request.Request(page + "api/" + name, data=b"", method="POST"), timeout=300)
attempts = [(f"open {path}", lambda path=path: open(path, "rb").read(1)) for path in files]
attempts += [(f"connect {path}", lambda path=path: connect(path)) for path in sockets]
for pid in pids:
    attempts.append((f"stop {pid}", lambda pid=pid: os.kill(pid, signal.SIGSTOP)))
    attempts.append((f"descriptors of {pid}", lambda pid=pid: os.listdir(f"/proc/{pid}/fd")))
    attempts.append((f"memory of {pid}", lambda pid=pid: open(f"/proc/{pid}/mem", "rb")))
attempts += [(f"command {name}", lambda name=name: command(name)) for name in ("arm", "safe_stop")]
for what, attempt in attempts:
    try:
        attempt()
    except PermissionError:
        continue
    except urllib.error.HTTPError as error:
        if error.code == 403:
            continue
    print(what)
print(len(attempts), "attempts")
"""


def _attacked(rig: Rig) -> tuple[list[str], list[str], list[int]]:
    """Return the files, sockets and processes of a rig, as who runs it sees them."""
    bus = rig.directory / "bus"
    folders = (bus, flight_directory(bus), rig.directory / "recordings")
    paths = {path for folder in folders for path in folder.rglob("*") if not path.is_dir()}
    sockets = sorted(str(path) for path in paths if path.is_socket())
    pids = list(rig.observer.pids().values())
    pids += [child for pid in (*pids, rig.process.pid) for child in _children(pid)]
    return sorted(str(path) for path in paths if path.is_file()), sockets, sorted({*pids, rig.process.pid})


def _attack(rig: Rig, page: str) -> tuple[list[str], list[str], list[int], subprocess.CompletedProcess[str]]:
    """Attack what stays, and return it with what came of it: some processes of a new rig end soon after they began."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        files, sockets, pids = _attacked(rig)
        done = as_other_user(_ATTACK, json.dumps((files, sockets, pids, page)))
        if {*pids} <= {*_attacked(rig)[2]} or time.monotonic() > end_s:
            return files, sockets, pids, done


def _children(pid: int) -> list[int]:
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_nothing_of_a_running_rig_is_to_be_had_by_another_user(rig: Rig) -> None:
    rig.observer.until(lambda: any((rig.directory / "recordings").glob("*.mcap")), 120.0, "a recording")
    rig.observer.until(lambda: rig.observer.is_up, PATIENCE_S, "running")
    before, page = rig.observer.pids(), json.loads((rig.directory / "bus" / "page.json").read_text())["address"]
    files, sockets, pids, done = _attack(rig, page)
    names = {Path(path).name for path in (*files, *sockets)}
    assert {"page.json", "gateway.state.ipc", "gateway.log", "physics.flight"} <= names
    assert any(name.endswith(".mcap") for name in names)
    assert done.stderr == ""
    assert done.stdout == f"{len(files) + len(sockets) + 3 * len(pids) + 2} attempts\n"
    rig.observer.until(lambda: rig.observer.is_up, PATIENCE_S, "running")
    assert rig.observer.pids() == before
    _assert_that_the_can_bus_is_nobody_elses(before["gateway"])


def _assert_that_the_can_bus_is_nobody_elses(gateway: int) -> None:
    """Frames to the emulated drives travel between sockets without a name: there is nothing to send to or to bind."""
    (drives,) = drives_of(gateway)
    links = [os.readlink(each) for each in Path(f"/proc/{drives}/fd").iterdir()]
    inodes = {found[1] for link in links if (found := re.fullmatch(r"socket:\[(\d+)\]", link))}
    assert len(inodes) >= 3, "the gateway's orders, and a bus a drive"
    named = {}
    for line in Path(f"/proc/{drives}/net/unix").read_text().splitlines()[1:]:
        words = line.split()
        named[words[6]] = words[7:]
    assert {inode: named.get(inode) for inode in inodes} == {inode: [] for inode in inodes}, "local, and nameless"
