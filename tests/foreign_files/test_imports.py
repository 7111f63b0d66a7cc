"""A reader imports what its kind of file needs: it is started beside whoever asks, with its first file."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["trocar.services.meshes.foreign", "trocar.services.recordings.foreign"])
def test_a_reader_imports_none_of_the_mechanics(module: str) -> None:
    told = f"import sys, {module}; print(*sys.modules)"
    names = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"numba", "scipy", "trimesh", "pyvista", "vtkmodules", "zmq", "pydantic"}
    assert not heavy & {name.partition(".")[0] for name in names}
    assert not [name for name in names if name.startswith("trocar.services.mechanics")]
