"""A soft duct bent far by two forceps: it keeps its volume, its contacts stay consistent, a catheter stays in it."""

from dataclasses import replace

import numpy as np
import pytest

import trocar.protocol.bodies as bodies
from tests.mechanics.collision.wall_cases import place, set_configuration
from tests.mechanics.reduction.large_rotations.warped import warped_positions
from trocar.protocol.arrays import pack
from trocar.services.mechanics.collision.placed_wall import place_wall
from trocar.services.mechanics.effects.large_rotations import LargeRotationsSettings
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame
from trocar.services.mechanics.scene import CatheterScene, DuctScene, ForcepsScene, SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.scenes.drawn_surface import DrawnSurface
from trocar.studies.energy_book import EnergyBook

# The first test of a fresh checkout compiles the kernels.
pytestmark = pytest.mark.timeout(600)

DEPTH_M, PUSH_TICKS, HOLD_TICKS = 24e-3, 700, 200


def soft_scene(effects=None, **catheter):
    """A duct of 1 mm and 60 kPa; the catheter lies far off unless told otherwise."""
    away = {"n_segments": 12, "length_m": 30e-3, "tip_position_m": (60e-3, 60e-3, 0.0), "anchor": "free"}
    return SceneModel(
        duct=DuctScene(n_around=16, n_along=26, n_modes=40, thickness_m=1e-3, youngs_modulus_pa=60e3, membrane="cst"),
        catheter=CatheterScene(**{**away, **catheter}),
        forceps=(
            ForcepsScene(port_position_m=(30e-3, -0.15, 6e-3)),
            ForcepsScene(port_position_m=(30e-3, -20e-3, 0.15)),
        ),
        effects=effects or {"large_rotations": LargeRotationsSettings()},
    )


def press_down(tools, tick):
    """One forceps lies across the duct and pushes it down, following its end; the other leans on the side."""
    part = min(tick / PUSH_TICKS, 1.0)
    tools.position_m[0] = 38e-3 - 0.45 * part * DEPTH_M, -8e-3, 6e-3 - part * DEPTH_M
    tools.position_m[1] = 20e-3, -8.0e-3 + 2.0e-3 * part, 12e-3


def wall_of(simulation):
    """Where collision detection has the wall, (n, 3)."""
    body = simulation.duct
    return placed(body.reduced, body.q_start, body.load_nodes[: body.n_loads], body.load_force_n[: body.n_loads])


def placed(duct, q, nodes, force_n):
    wall = place_wall(duct)
    set_configuration(wall, q, (nodes, force_n))
    place(wall)
    return wall.position


def enclosed_volume_m3(mesh, at):
    a, b, c = (at[mesh.triangles[:, k]] for k in range(3))
    volume = np.sum(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6.0
    for name, sign in (("clamped", 1.0), ("mouth", -1.0)):
        rim = at[mesh.vertex_sets[name]]
        volume -= sign * (np.cross(rim, np.roll(rim, -1, axis=0)) @ rim.mean(axis=0)).sum() / 6.0
    return abs(volume)


@pytest.fixture(scope="module")
def duct(cache_dir):
    return build_scene_duct(soft_scene(), cache_dir)


@pytest.fixture(scope="module")
def bent(duct):
    """The end of the push: the simulation, its energy flow on the way, the worst overlap, and the loads before."""
    simulation, tools = Simulation(soft_scene(), duct), ToolInputs()
    tools.present[:] = True
    press_down(tools, 0)
    simulation.step(tools)
    book, flows, overlap_m = EnergyBook(simulation), [], 0.0
    for tick in range(PUSH_TICKS + HOLD_TICKS):
        press_down(tools, tick)
        begun = loads_of(simulation.duct)
        book.step(tools)
        flow = book.flow
        flows.append((flow.input_j, flow.stored_j, flow.dissipated_j))
        overlap_m = max(overlap_m, simulation.max_penetration_m)
    return simulation, np.array(flows), overlap_m, begun


def loads_of(body):
    """Nodes and forces of a duct's loads, copied."""
    return body.load_nodes[: body.n_loads].copy(), body.load_force_n[: body.n_loads].copy()


def loads_as_solved(body):
    """The same along the axes that sections had at the start of the last step."""
    (nodes, loads), frame = loads_of(body), SectionFrame(body.reduced.warp)
    frame.update(body.state.q)
    frame.turn_back(nodes, loads, loads)
    frame.update(body.q_start)
    frame.turn_vectors(nodes, loads, loads)
    return nodes, loads


def test_a_duct_bent_far_by_forceps_keeps_its_volume(duct, bent):
    simulation = bent[0]
    mesh, q = duct.mesh, simulation.duct.q_start
    frame = SectionFrame(duct.warp)
    frame.update(q)
    turned_deg = np.degrees(np.linalg.norm(frame.turns[-1]))
    rest = enclosed_volume_m3(mesh, mesh.vertices_m)
    change = enclosed_volume_m3(mesh, wall_of(simulation)) / rest - 1.0
    linear = enclosed_volume_m3(mesh, mesh.vertices_m + duct.basis.displacements(q)) / rest - 1.0
    print(f"mouth turned by {turned_deg:.0f} degrees: volume {change:+.2%}, with straight modes {linear:+.0%}")
    assert turned_deg > 45.0
    assert linear > 0.2
    assert abs(change) < 0.01


def test_forces_and_motions_at_contacts_do_the_same_virtual_work(duct, bent):
    """J^T f from the loads on nodes and the warp's own derivative, against what contacts gave the modes.

    Loads turn along to the end of the step; what those before it have displaced rides along.
    """
    body, frame = bent[0].duct, SectionFrame(duct.warp)
    nodes, loads = loads_as_solved(body)
    frame.update(body.q_start)
    begun = bent[3][1].copy()
    frame.turn_back(bent[3][0], begun, begun)
    rows, carried_m = np.empty((len(nodes), 3, duct.basis.n_modes)), np.zeros((len(nodes), 3))
    duct.residual.apply(bent[3][0], begun, nodes, carried_m)
    frame.node_rows(nodes, carried_m, rows)
    expected = np.einsum("nir,ni->r", rows, loads)
    assert len(nodes) >= 6  # only nodes that carry a force are listed: two pressed contacts
    assert body.contact_impulse == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    rows_of_points = np.empty_like(rows)
    frame.node_rows(nodes, np.zeros_like(carried_m), rows_of_points)
    without = np.einsum("nir,ni->r", rows_of_points, loads)
    assert np.abs(without - expected).max() > 1e-3 * np.abs(expected).max()
    straight = np.einsum("nir,ni->r", duct.basis.Phi[nodes], loads)
    assert np.abs(straight - expected).max() > 0.05 * np.abs(expected).max()


def test_a_pressed_point_goes_where_its_row_says_while_its_section_turns(duct):
    """The same force for two steps in which the wall swings: its dent rides along, as its row says."""
    body, dt_s = Simulation(soft_scene(), duct).duct, 1e-4
    nodes, weights = duct.mesh.triangles[[500]].astype(np.int32), np.full((1, 3), 1.0 / 3.0)
    force_n = np.array([[0.1, 0.03, -0.2]])
    body.state.q[:] = duct.basis.Phi[nodes[0, 0], 2] / duct.basis.omega_rad_s**2
    body.state.q *= 0.4 / np.linalg.norm(duct.warp.turn[-1] @ body.state.q)
    for _ in range(2):
        body.state.qdot[:] = body.state.q / 0.2
        start_m, started_m = place_of(body, nodes[0]), place_of(body, nodes[0], loaded=False)
        body.predict(dt_s)
        body.gather(nodes, weights)
        modes, dent_m = body.modes[:3].copy(), np.zeros((3, 3))
        body.correct(nodes, weights, force_n)
        body.reduced.residual.apply(nodes[0], -force_n / 3.0 * np.ones((3, 1)), nodes[0], dent_m)
        foretold_m = modes @ (body.state.q - body.q_start) + dent_m.mean(axis=0) - (start_m - started_m)
    moved_m = place_of(body, nodes[0]) - start_m
    turned = np.linalg.norm(duct.warp.turn[-1] @ (body.state.q - body.q_start))
    by_turning_m = turned * np.linalg.norm(dent_m.mean(axis=0))
    print(f"{1e6 * np.abs(foretold_m - moved_m).max():.2f} um off, a dent turned by {1e6 * by_turning_m:.1f} um")
    assert by_turning_m > 0.5e-6
    assert foretold_m == pytest.approx(moved_m, abs=0.1 * by_turning_m)


def place_of(body, nodes, *, loaded=True):
    """The middle of three nodes where a duct is now, with what its loads displace or without."""
    return (body.surface_m() if loaded else warped_positions(body.reduced.warp, body.state.q))[nodes].mean(axis=0)


def test_what_the_tools_feel_the_wall_feels_reversed(bent):
    simulation = bent[0]
    on_tools = simulation.contact_force_n.sum(axis=0)
    on_wall = loads_as_solved(simulation.duct)[1].sum(axis=0)
    assert np.linalg.norm(on_tools) > 5e-3
    assert on_wall == pytest.approx(-on_tools, rel=1e-9)


def test_turned_compliance_is_what_a_unit_force_does(duct, bent):
    """W of the contacts, column by column, against displacements that the body itself makes of a load."""
    body, rows = bent[0].duct, bent[0].contacts
    n = rows.n_contacts
    nodes, weights = rows.duct_node[:n].copy(), rows.duct_weight[:n].copy()
    gathered = np.empty((3 * n, 3 * n))
    body.reduced.residual.gather_points(nodes, weights, gathered, np.arange(n, dtype=np.int32))
    touched = np.unique(nodes)
    for column in (0, 3 * n - 2):
        point, axis = divmod(column, 3)
        loads = np.zeros((len(touched), 3))
        for corner in range(3):
            loads[touched == nodes[point, corner], axis] += weights[point, corner]
        moved = np.zeros((len(touched), 3))
        body.reduced.residual.apply(touched, loads, touched, moved)
        at_points = np.einsum("pc,pci->pi", weights, moved[np.searchsorted(touched, nodes)])
        assert gathered[:, column] == pytest.approx(at_points.ravel(), abs=1e-10 * np.abs(gathered).max())
    gain, rows_of_modes, whole = body.position_gain, body.modes[: 3 * n], np.zeros((3 * n, 3 * n))
    body.compliance(nodes, weights, whole)
    expected = np.tril(gathered + (rows_of_modes * gain) @ rows_of_modes.T)
    assert np.tril(whole) == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


def test_energy_is_only_what_the_hands_put_in(bent):
    """Stored energy never exceeds the work of the hands, and the books balance to a hundred-thousandth of it."""
    put_in, stored, dissipated = bent[1].T
    largest = put_in.max()
    print(f"of {1e3 * largest:.3f} mJ put in, {1e6 * np.abs(put_in - stored - dissipated).max():.2f} uJ unaccounted")
    assert (stored <= put_in + 0.005 * largest).all()
    assert np.abs(put_in - stored - dissipated).max() < 1e-5 * largest
    assert bent[2] < 0.3e-3, "the wall gives way before anything sinks in"


def test_a_catheter_in_a_bent_duct_stays_inside(duct):
    scene = soft_scene(
        tip_position_m=(6e-3, 0.0, 0.0), length_m=30e-3, n_segments=20, youngs_modulus_pa=5e6, outer_diameter_m=1.67e-3
    )
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[:] = True
    for tick in range(PUSH_TICKS + HOLD_TICKS):
        press_down(tools, tick)
        simulation.step(tools)
        assert simulation.inside.all(), f"tick {tick}"
    bend_m = np.ptp(simulation.catheter.state.position_m[:, 2])
    assert bend_m > 3e-3, "the duct has taken the catheter along"
    assert simulation.inserted_length_m == pytest.approx(scene.catheter.length_m)


def test_picture_and_detection_show_the_same_wall(duct, bent):
    """One load on the bent wall: both have its dent everywhere."""
    q, node, force_n = bent[0].duct.q_start, np.array([300], np.int32), np.array([[0.0, 0.02, -0.01]])
    at, drawn = placed(duct, q, node, force_n), DrawnSurface(duct)
    empty = pack(np.zeros(0))
    loads = {"load_node": pack(node, "<i4"), "load_force_n": pack(force_n)}
    frame = bodies.Duct(basis_hash=duct.basis.content_hash, q=pack(q), q_rate=empty, **loads)
    assert drawn.update(frame)
    off = np.linalg.norm(drawn.points_m - at, axis=1)
    dent = np.linalg.norm(at - warped_positions(duct.warp, q), axis=1).max()
    assert dent > 0.1e-3
    assert off.max() < 1e-8, "float32 of positions of centimetres"


def test_without_loads_it_stays_at_rest(duct):
    simulation, tools = Simulation(soft_scene(), duct), ToolInputs()
    tools.present[:] = False
    for _ in range(20):
        simulation.step(tools)
    assert not simulation.duct.state.q.any()
    assert wall_of(simulation) == pytest.approx(duct.mesh.vertices_m, abs=1e-15)


def test_surfaces_that_are_no_tube_are_refused(duct, tmp_path):
    mesh = duct.mesh
    pierced = TriangleMesh(mesh.vertices_m, np.delete(mesh.triangles, 300, axis=0), mesh.vertex_sets)
    with pytest.raises(ValueError, match=r"effects.large_rotations: .* two open ends, its surface has 3"):
        build_scene_duct(soft_scene(), tmp_path, mesh=pierced)
    ends = np.concatenate([mesh.vertex_sets["clamped"], mesh.vertex_sets["mouth"]])
    held_twice = TriangleMesh(mesh.vertices_m, mesh.triangles, {**mesh.vertex_sets, "clamped": ends})
    with pytest.raises(ValueError, match=r"effects.large_rotations: .* held at one whole end"):
        build_scene_duct(soft_scene(), tmp_path, mesh=held_twice)
    with pytest.raises(ValueError, match="too coarse for 60 cross-sections"):
        build_scene_duct(soft_scene({"large_rotations": LargeRotationsSettings(n_sections=60)}), tmp_path)


def test_a_duct_of_another_scene_is_refused(duct):
    with pytest.raises(ValueError, match="built without it"):
        Simulation(soft_scene(), replace(duct, warp=None))
