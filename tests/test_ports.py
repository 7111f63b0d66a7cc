"""Two test runs beside each other never meet on a port."""

from __future__ import annotations

import itertools
import socket
import subprocess
import sys
import zlib
from pathlib import Path

from tests import ports
from trocar.protocol.topics import TOPICS
from trocar.services.runtime.bus.frame_batches import batch_endpoint

_SAYS = "from tests.ports import base_port, free_port; print(base_port(0), free_port())"


def test_another_run_has_other_ports() -> None:
    ours = ports.base_port(0)
    said = subprocess.run([sys.executable, "-c", _SAYS], capture_output=True, text=True, check=True)
    other_base, other_free = map(int, said.stdout.split())
    assert ours != other_base
    ranges = [(port - ports._FIRST) // ports._EACH for port in (ports.free_port(), other_free)]
    assert ranges[0] != ranges[1], "each has a range of its own"


def test_topics_of_two_runs_are_apart() -> None:
    names = {*TOPICS, *map(batch_endpoint, TOPICS)}
    places = sorted(zlib.crc32(name.encode()) % 8192 for name in names)
    assert min(after - before for before, after in itertools.pairwise(places)) >= ports._NUMBERS


def test_a_port_that_is_taken_is_left_out_and_none_is_given_twice() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert not ports._is_free(taken.getsockname()[1], socket.SOCK_STREAM)
    given = [ports.free_port() for _ in range(20)]
    assert len(set(given)) == 20
    first_of_system = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    assert max(given) < first_of_system
