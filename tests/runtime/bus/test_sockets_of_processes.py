"""Every process has a socket for each topic that the table gives it, of the kind that the table says, and no other."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from trocar.protocol import PROCESSES, TOPICS
from trocar.protocol.topics import observed_by, published_by, read_by
from trocar.services.supervisor.crew.processes import TABLE

#: Opens each process as its entry point does, up to the call of its loop, and tells which sockets there are then.
OPEN = """
import json, runpy, sys
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.process import process
from trocar.services.runtime.bus.frame_batches import batch_endpoint
from trocar.services.supervisor import session

rig, scene = sys.argv[1:]
entered = {}

def entry(name, run, arguments=None, *, prepare=None, whole=None):
    entered[name] = whole
    return 0

def sockets(bus, transport, names, which, direct):
    import zmq
    there = {socket.getsockopt(zmq.LAST_ENDPOINT).rstrip(b"\\0").decode() for socket in which.values()}
    there |= {f"ipc://{end.path}" for end in direct.values()}
    fast = {name for name in names if endpoints.endpoint(transport, name) in there}
    batched = {name for name in names if endpoints.endpoint(transport, batch_endpoint(name)) in there} - fast
    return sorted(fast | batched), len(there), sorted(batched)

process.main = entry
found = {}
from trocar import protocol
for name in protocol.PROCESSES:
    options = process.Options(rig, scene, ())
    if name == "supervisor":
        opened = session.open_session(options)
    else:
        try:
            runpy.run_module(f"trocar.services.{name}", run_name="__main__")
        except SystemExit:
            pass
        config = process.load_process_config(name, options)
        opened = process.open_process(config, entered[name](config) if entered[name] else ())
    bus, transport = opened.bus, opened.rig.transport
    out, n_out, _none = sockets(bus, transport, protocol.TOPICS, bus._senders, bus._direct_senders)
    into, n_in, at_whole = sockets(bus, transport, protocol.TOPICS, bus._receivers, bus._direct_readers)
    found[name] = {"publishes": out, "reads": into, "n": [n_out, n_in], "whole": at_whole}
    bus.close()
print(json.dumps(found))
"""


Sockets = dict[str, dict[str, list[str]]]


def sockets_in(scene: str) -> Sockets:
    """Open each process of a rig with a scene, and return its sockets."""
    with tempfile.TemporaryDirectory() as folder:  # a test's own has a path that may be too long for a socket
        rig = Path(folder) / "rig.yaml"
        rig.write_text(f"{{name: sockets, transport: {{directory: {folder}/bus}}}}\n")
        command = [sys.executable, "-c", OPEN, str(rig), scene]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ)
    assert done.returncode == 0, done.stderr
    found: Sockets = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def sockets() -> Sockets:
    return sockets_in("default")


def test_for_a_duct_alone_there_is_no_socket_of_contact() -> None:
    found = sockets_in("duct-only")
    of_contact = {name for name, row in TOPICS.items() if row.publisher in ("gateway", "haptics")}
    assert {"gateway.state", "haptics.contacts"} <= of_contact
    for process in ("physics", "visualization", "recorder", "supervisor"):
        assert not of_contact & set(found[process]["reads"]), process
        assert "visualization.hands" not in found[process]["publishes"]
        assert found[process]["n"] == [len(found[process]["publishes"]), len(found[process]["reads"])]
    assert found["physics"]["publishes"] == sorted(published_by("physics"))
    assert found["physics"]["reads"] == sorted({*read_by("physics"), *observed_by("physics")} - of_contact)


@pytest.mark.parametrize("process", PROCESSES)
def test_a_process_has_the_sockets_that_the_table_says(sockets: Sockets, process: str) -> None:
    publishes, reads = sorted(published_by(process)), sorted((*read_by(process), *observed_by(process)))
    whole = ["gateway.state"] if process == "recorder" else []  # as the rig file has it
    counts = [len(publishes), len(reads)]
    assert sockets[process] == {"publishes": publishes, "reads": reads, "n": counts, "whole": whole}


def test_every_declared_reader_and_observer_has_one(sockets: Sockets) -> None:
    for row in TOPICS.values():
        for process in (*row.readers, *row.observers):
            assert row.name in sockets[process]["reads"], f"{process} is named by {row.name} and does not hear it"


def test_the_supervisor_observes_every_stream_that_tells_of_a_hang() -> None:
    assert {spec.stream for spec in TABLE if spec.stream} <= set(observed_by("supervisor"))
