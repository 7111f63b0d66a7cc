"""Threads of a rig are counted under the process that they belong to, whatever forked it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from benchmarks.rig_threads import watch
from tests.patience import PATIENCE_S


@pytest.fixture(params=["trocar.services.gateway", "trocar.review.school"])
def rig(request: pytest.FixtureRequest) -> Iterator[tuple[str, int]]:
    """Return a module, and the id of a process whose child says that it runs this."""
    text = f"import subprocess, sys; subprocess.run([sys.executable, '-c', 'input()', {request.param!r}])"
    with subprocess.Popen([sys.executable, "-c", text], stdin=subprocess.PIPE) as process:
        yield request.param, process.pid
        process.communicate(b"\n")


def test_a_process_is_named_by_its_module_and_others_are_the_supervisors(rig: tuple[str, int]) -> None:
    module, root = rig
    name = f"{module.removeprefix('trocar.').removeprefix('services.')}, loop"
    end_s = time.monotonic() + PATIENCE_S
    while (found := set(watch(root, 0.01)["threads"])) != {"supervisor, loop", name}:
        assert time.monotonic() < end_s, found
