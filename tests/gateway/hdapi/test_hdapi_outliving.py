"""A thread of the library that calls on after `hdStopScheduler`, with the address that it was given."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.hdapi.hdapi_library import HdapiStandIn

#: Opens and closes both arms again and again while threads of the library call on, and gives their memory to others.
PROGRAM = """
import gc, sys, time
from pathlib import Path
import numpy as np
from tests.gateway.hdapi.hdapi_bench import HdapiBench
from tests.gateway.hdapi.hdapi_library import HdapiStandIn
standin = HdapiStandIn(Path(sys.argv[1]), threaded=True)
bench = HdapiBench(standin)
standin.c.standin_outlive(1500)
for _ in range(4):
    bench.open()
    time.sleep(0.05)
    bench.close()
    gc.collect()
    others = [np.full(n, 7.5) for n in range(1, 4000)]
    time.sleep(0.1)
for arm in (1, 2):
    assert standin.force_n(arm) == 0.0, "it pushes after it was closed"
print("whole")
"""


@pytest.mark.timeout(600)
def test_a_thread_that_outlives_the_stop_finds_its_cell_and_moves_nothing(tmp_path: Path) -> None:
    try:
        with HdapiStandIn.compiled(tmp_path) as standin:
            library = standin.path
    except BenchUnavailable as reason:
        pytest.skip(str(reason))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(library)], capture_output=True, text=True, check=False, timeout=300
    )
    assert (done.returncode, done.stdout.strip(), done.stderr.strip()) == (0, "whole", "")
