"""What a test has started ends when the test is killed."""

from __future__ import annotations

import os
import select
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.with_us import with_us

_TEST = """
import subprocess, sys
child = subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE)
print(child.pid, child.stdout.readline().decode().strip(), flush=True)
sys.stdin.read()
"""
#: Says who it is, then when it was asked to end.
_CHILD = """
import os, pathlib, signal, sys
signal.signal(signal.SIGTERM, lambda *_: (pathlib.Path(sys.argv[1]).write_text("asked"), os._exit(0)))
print(os.getpid(), flush=True)
while True:
    signal.pause()
"""


@pytest.mark.skipif(shutil.which("setpriv") is None, reason="there is no setpriv here (util-linux)")
def test_a_child_is_asked_to_end_when_its_test_is_killed(tmp_path: Path) -> None:
    said = tmp_path / "said"
    command = with_us([sys.executable, "-c", _CHILD, str(said)])
    test = subprocess.Popen(
        [sys.executable, "-c", _TEST, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert test.stdout is not None
    started, itself = map(int, test.stdout.readline().split())
    assert started == itself
    child = os.pidfd_open(started)
    test.send_signal(signal.SIGKILL)
    test.communicate()
    assert select.select([child], [], [], 60.0)[0], "it lives"
    os.close(child)
    assert said.read_text() == "asked"
