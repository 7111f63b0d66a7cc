"""Processes that compute for another one are gone when it is, by whatever end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from trocar.studies.pool import open_pool

WORK = """
import os, signal, sys, time
from pathlib import Path
from trocar.studies.pool import open_pool

def work(folder, much):
    (Path(folder) / str(os.getpid())).touch()
    while True:
        time.sleep(0.1)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's jobs in the background ignore it
    with open_pool(2) as pool:
        for call in [pool.submit(work, sys.argv[1], bytes(1 << 20)) for _ in range(4)]:
            call.result()
"""


@pytest.mark.parametrize("told", [signal.SIGKILL, signal.SIGINT], ids=["killed", "interrupted"])
def test_workers_in_the_middle_of_something_are_gone_when_their_parent_is(tmp_path, told):
    """Those of a killed run stayed for ever; an interrupted one waited for all that it had asked for."""
    script, pids = tmp_path / "script.py", tmp_path / "pids"
    script.write_text(WORK)
    pids.mkdir()
    parent = subprocess.Popen(
        [sys.executable, script, pids], stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": os.getcwd()}
    )
    try:
        assert _until(lambda: len(list(pids.iterdir())) == 2)
        parent.send_signal(told)
        parent.wait(timeout=PATIENCE_S)
        assert _until(lambda: not any(_runs(each.name) for each in pids.iterdir()))
    finally:
        parent.kill()
        for each in pids.iterdir():
            if _runs(each.name):
                os.kill(int(each.name), signal.SIGKILL)


def test_what_fails_there_is_told_here():
    with pytest.raises(ZeroDivisionError), open_pool(1) as pool:
        pool.submit(divmod, 1, 0).result()


def _runs(pid):
    """Whoever is dead may still be there, unless its new parent cares for it."""
    try:
        return Path("/proc", pid, "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def _until(is_so):
    end = time.monotonic() + 60.0
    while time.monotonic() < end and not is_so():
        time.sleep(0.1)
    return is_so()
