"""A gateway imports nothing that it can do without: it is the last to start, and a rig waits for it."""

from __future__ import annotations

import subprocess
import sys


def test_a_gateway_brings_no_solvers() -> None:
    code = (
        "import sys, trocar.services.gateway.__main__\n"
        "print(*{'scipy.sparse', 'scipy.linalg', 'pyvista'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
