"""Two forceps poke a scanned vessel for a second: what they do to it stays bounded, and it comes back."""

from pathlib import Path

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct, load_scene
from trocar.studies.energy_book import EnergyBook, stored_energies_j

pytestmark = pytest.mark.timeout(600)

ANATOMY = Path(__file__).parents[3].parent / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"
POKE_M, TICKS, REST_TICKS = 6e-3, 1000, 400


def poke(tools, tick):
    """Jaws ahead, in and out four and six times a second, from both sides and from place to place."""
    in_out = 0.5 * (1.0 - np.cos(2.0 * np.pi * tick * np.array([4e-3, 6e-3])))
    tools.position_m[0] = 22e-3 + 4e-3 * np.sin(tick / 300.0), 22.5e-3 - POKE_M * in_out[0], 1e-3
    tools.position_m[1] = 30e-3, -22.5e-3 + POKE_M * in_out[1], -1e-3
    tools.jaw_angle_rad[:] = 0.2


@pytest.fixture(scope="module")
def vessel(cache_dir):
    if not ANATOMY.exists():
        pytest.skip(f"needs the scan {ANATOMY.name}, which is not part of the repository")
    pytest.importorskip("trimesh", reason="needs the mesh packages")
    scene = load_scene("anatomy", [f"duct.mesh_file={ANATOMY}"])
    return scene, load_duct(scene, cache_dir, lambda stage, fraction: None)


def test_a_second_of_poking_stays_bounded(vessel):
    scene, duct = vessel
    simulation, tools = Simulation(scene, duct), ToolInputs()
    poke(tools, 0)
    simulation.step(tools)
    book, moved_m, stored_j, touching = EnergyBook(simulation), 0.0, [], 0
    for tick in range(TICKS):
        poke(tools, tick)
        book.step(tools)
        moved_m = max(moved_m, np.abs(duct.basis.displacements(simulation.duct.state.q)).max())
        stored_j.append((book.flow.input_j, book.flow.stored_j))
        touching += bool(simulation.contact_force_n.any())
        assert simulation.max_penetration_m < 0.5e-3
    put_in, stored = np.array(stored_j).T
    print(f"touching in {touching} ticks, moved by up to {1e3 * moved_m:.1f} mm, {1e3 * stored.max():.2f} mJ stored")
    assert touching > TICKS // 4
    assert 2e-3 < moved_m < 2.0 * POKE_M
    assert (stored <= put_in + 0.01 * put_in.max()).all(), "nothing but the hands puts energy in"
    tools.present[:] = False
    for _ in range(REST_TICKS):
        simulation.step(tools)
    assert stored_energies_j(simulation)["duct"] < 0.01 * stored.max()


def test_a_surface_file_that_is_not_there_is_one_sentence(tmp_path):
    scene = load_scene("anatomy")
    assert scene.duct.mesh_file.endswith("configs/scenes/surface.stl")
    with pytest.raises(ConfigError, match=r"anatomy.yaml: duct.mesh_file: .*surface.stl: no such file"):
        load_duct(scene, tmp_path, lambda stage, fraction: None)


def test_large_rotations_refuse_a_vessel_that_branches(vessel, cache_dir):
    scene = load_scene("anatomy", [f"duct.mesh_file={ANATOMY}", "effects.large_rotations={}"])
    with pytest.raises(ConfigError, match=r"anatomy.yaml: effects.large_rotations: .*two open ends, its surface has 3"):
        load_duct(scene, cache_dir, lambda stage, fraction: None)
