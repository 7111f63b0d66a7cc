"""The scripts in docs/examples do what they say."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


def test_pinched_duct_pushes_the_jaws_open(capsys):
    told = runpy.run_path(str(EXAMPLES / "pinched_duct.py"))
    assert told["torque_nm"] > 1e-5
    assert told["simulation"].tools.proxy[0, 3] > told["angle_rad"]
    assert "mN m" in capsys.readouterr().out


def test_insertion_is_written_for_paraview(tmp_path, monkeypatch, capsys):
    meshio = pytest.importorskip("meshio")
    monkeypatch.setattr("sys.argv", ["insertion_to_vtu.py", str(tmp_path)])
    runpy.run_path(str(EXAMPLES / "insertion_to_vtu.py"))
    files = sorted(tmp_path.glob("*.vtu"))
    assert len(files) == 44
    last = meshio.read(files[-1])
    assert abs(last.point_data["displacement_m"]).max() > 1e-4
    assert "44 files" in capsys.readouterr().out
