"""The folder that the verb writes: its scene runs, and the catheter goes in."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.anatomy.phantoms import curved, forked, s_shaped, scan
from tests.anatomy.volumes import write_slicer
from tests.by_day import by_day
from tests.cli.conftest import Trocar
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.surface.branched_tubes import Tube
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of

pytest.importorskip("SimpleITK", reason="the scan extra is not installed")


@pytest.mark.parametrize("tubes", by_day([forked], [curved, s_shaped]), ids=lambda tubes: tubes.__name__)
def test_a_scan_becomes_a_scene_in_which_the_catheter_goes_in(
    tubes: Callable[[], list[Tube]], trocar: Trocar, tmp_path: Path, own_cache: Path
) -> None:
    path = write_slicer(scan(tubes(), (0.6, 0.6, 0.6), noise_mm=0.1), tmp_path / "duct.seg.nrrd", {1: "Duct"})
    ran = trocar("anatomy", path, "--out", tmp_path / "made", "--thickness-mm", "0.8", "--json")
    assert ran.code == 0, ran.err
    told = json.loads(ran.out)
    assert {p.name for p in (tmp_path / "made").iterdir()} == {
        "surface.vtp", "scene.yaml", "preview.png", "report.md", "report.json",
    }  # fmt: skip
    assert told["wall"]["thickness_mm"] == 0.8
    scene = load_scene(tmp_path / "made" / "scene.yaml", ["duct.n_modes=30"])
    duct = load_duct(scene, own_cache, lambda stage, fraction: None)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    hands, largest_n = hands_of(simulation.scene, duct.mesh), 0.0
    for tick in range(round(1000 * hands.duration_s)):
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
        largest_n = max(largest_n, float(np.linalg.norm(simulation.tool_results.force_n, axis=1).max()))
    assert simulation.inserted_length_m > 12e-3
    assert largest_n < 1.0


def test_a_file_that_is_refused_leaves_no_folder(trocar: Trocar, tmp_path: Path) -> None:
    (tmp_path / "x.nrrd").write_text("a letter\n")
    ran = trocar("anatomy", tmp_path / "x.nrrd", "--out", tmp_path / "made")
    assert ran.code == 2
    assert ran.err.splitlines()[-1].startswith(f"trocar: {tmp_path / 'x.nrrd'}: not a readable volume")
    assert not (tmp_path / "made").exists()
