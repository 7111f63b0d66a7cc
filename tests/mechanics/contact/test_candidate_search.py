"""What the search of a scene hands over: spheres, sides that are kept within a step, and the room in jaws."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS
from trocar.services.mechanics.collision.candidate_list import TOUCHING_M
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, JAW_A, JAW_B, NO_TOOL, SHAFT, ContactPairs
from trocar.services.mechanics.contact.clearance import jaw_surface, overlap_in_jaws
from trocar.services.mechanics.contact.working_set import IMPLIED_M
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.judge.closest import segment_triangle

TOLERANCE_M, AT_M = 20e-6, 20e-3


@pytest.fixture
def simulation(small_scene, small_duct):
    """Everything at rest, tools gone, after one step."""
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    tools.present[:] = False
    simulation.step(tools)
    return simulation


def facet(simulation, angle_rad):
    """Return the middle of a triangle of the wall near a place, and its unit normal towards the axis."""
    corners = simulation.duct.surface_m()[simulation.duct.reduced.mesh.triangles]
    middle = corners.mean(axis=1)
    aim = np.array([AT_M, np.cos(angle_rad) * 4e-3, np.sin(angle_rad) * 4e-3])
    k = int(np.argmin(np.linalg.norm(middle - aim, axis=1)))
    normal = np.cross(corners[k, 1] - corners[k, 0], corners[k, 2] - corners[k, 0])
    normal *= -np.sign(normal @ (middle[k] * [0.0, 1.0, 1.0])) / np.linalg.norm(normal)
    return middle[k], normal


def price(simulation, end_m):
    """Return the pairs of a step that has led the catheter to these places (n, 3)."""
    pairs = ContactPairs.zeros(capacity=64)
    simulation.catheter.state.position_m[:] = end_m
    simulation.search.price(simulation.system, TOLERANCE_M, pairs)
    return pairs


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    angle_rad=st.floats(0.0, 6.28),
    gap_um=st.floats(5.0, 300.0),
    beyond_um=st.floats(20.0, 700.0),
    is_inside=st.booleans(),
)
def test_who_goes_through_the_middle_surface_in_a_step_is_held_on_the_side_of_its_start(
    simulation, angle_rad, gap_um, beyond_um, is_inside
):
    """The row's normal points to where it came from, and its gap is how far beyond that side it ends."""
    middle, normal = facet(simulation, angle_rad)
    side = normal if is_inside else -normal
    reach_m = simulation.catheter.radius_m + 0.5 * simulation.scene.duct.thickness_m
    along = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    line = middle + (reach_m + 1e-6 * gap_um) * side + np.outer(np.arange(31) - 15.5, 0.3e-3 * along)
    simulation.search.forget()
    simulation.catheter.state.position_m[:] = simulation.catheter.start_m[:] = line
    simulation.search.begin(simulation.system)
    way_m = reach_m + 1e-6 * (gap_um + beyond_um)
    pairs = price(simulation, line - way_m * side)
    assert pairs.count > 0
    rows = slice(pairs.count)
    assert (pairs.tool[rows] == NO_TOOL).all()
    assert (pairs.normal[rows] @ side > 0.7).all()
    straight = pairs.normal[rows] @ side > 1.0 - 1e-9  # of facets beside it a row knows the step to first order
    assert straight.any()
    assert pairs.gap_m[rows][straight] == pytest.approx(1e-6 * gap_um - way_m, rel=1e-6)


@pytest.mark.parametrize("radius_m", [0.5e-3, 1.5e-3])
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_a_sphere_touches_what_is_nearest_of_all_triangles(small_scene, small_duct, radius_m, seed):
    """In the lumen, in the wall, outside and on the rim, wherever its centre is put."""
    simulation = Simulation(small_scene, small_duct)
    search, rng, tools = simulation.search, np.random.default_rng(seed), ToolInputs()
    spheres, pairs = simulation.system.geometry.spheres, ContactPairs.zeros(capacity=256)
    simulation.world.add_spheres(np.array([radius_m]))
    tools.present[:] = False
    corners = simulation.duct.surface_m()[small_duct.mesh.triangles]
    number = simulation.catheter.properties.n_segments
    for _ in range(6):
        angle, out_m = rng.uniform(0.0, 6.28), rng.uniform(0.0, 7e-3)
        spheres.start[0] = rng.uniform(2e-3, 42e-3), out_m * np.cos(angle), out_m * np.sin(angle)
        search.forget()
        search.begin(simulation.system)
        pairs.clear()
        search.write_pairs(simulation.system.address, pairs)
        on_wall = pairs.target_kind[: pairs.count] == DUCT_TRIANGLE
        of_sphere = np.flatnonzero(on_wall & (pairs.particle[: pairs.count] == number))
        p = tuple(spheres.start[0])
        gaps_m = np.array([np.sqrt(segment_triangle(p, p, *map(tuple, c))[0]) for c in corners])
        gaps_m -= radius_m + 0.5 * small_scene.duct.thickness_m
        assert (len(of_sphere) > 0) == (gaps_m.min() <= IMPLIED_M + TOUCHING_M)
        for k in of_sphere:
            assert pairs.gap_m[k] == pytest.approx(gaps_m[pairs.target[k]], abs=1e-12)
            assert pairs.tool[k] == NO_TOOL
        if len(of_sphere):
            assert pairs.gap_m[of_sphere].min() == pytest.approx(gaps_m.min(), abs=1e-12)


@pytest.mark.parametrize("apart_m", [0.0, 0.3e-3])
def test_beside_the_line_in_which_jaws_are_nearest_there_is_more_room(simulation, small_scene, apart_m):
    """By walking along the normal from the jaw to the plane midway between the jaws."""
    tools, thickness_m = simulation.system.geometry.tools, small_scene.duct.thickness_m
    tools.frame[0] = np.eye(3)
    tools.indentation[0], tools.layers[0] = 0.5 * thickness_m - 0.25 * apart_m, 2.0
    radius_m = tools.radius[0, JAW_A]
    for angle in (0.0, 0.2, 0.5):
        normal = np.array([np.cos(angle), np.sin(angle), 0.0])
        walk_m = np.linspace(0.0, 5e-3, 500_001)
        x_m = (radius_m + walk_m) * normal[0]
        half_layer_m = 0.5 * walk_m[np.searchsorted(x_m, radius_m + 0.5 * apart_m)]
        expected_m = max(0.5 * thickness_m - half_layer_m, 0.0)
        assert overlap_in_jaws(tools, JAW_A, 0.5, tuple(normal)) == pytest.approx(expected_m, abs=1e-8)


def test_between_jaws_there_is_as_much_room_as_they_have_squeezed_away(simulation):
    """Only towards each other, and cell by cell along them."""
    tools = simulation.system.geometry.tools
    tools.frame[0] = np.eye(3)  # they open along x
    tools.indentation[0] = 1e-4 * np.arange(N_CELLS)
    opening = np.array([1.0, 0.0, 0.0])
    between = {JAW_A: tuple(opening), JAW_B: tuple(-opening)}
    for jaw, normal in between.items():
        away = tuple(-np.array(normal))
        for cell in range(N_CELLS):
            s = (cell + 0.5) / N_CELLS
            assert overlap_in_jaws(tools, jaw, s, normal) == pytest.approx(1e-4 * cell)
            assert overlap_in_jaws(tools, jaw, s, away) == 0.0
        assert overlap_in_jaws(tools, jaw, 1.0 / N_CELLS, normal) == pytest.approx(0.5e-4)
    assert overlap_in_jaws(tools, SHAFT, 0.5, between[JAW_A]) == 0.0
    assert overlap_in_jaws(tools, 3 + JAW_A, 0.5, between[JAW_A]) == 0.0, "of the other tool"
    tools.held[0, DUCT_TRIANGLE], tools.rest_offset[0] = True, 0.2e-3
    assert overlap_in_jaws(tools, JAW_A, 0.0, tuple(-opening)) == pytest.approx(0.2e-3)


@pytest.mark.parametrize("film_first", [True, False])
def test_rows_of_a_film_are_seen_whoever_is_prepared_first(small_scene, small_duct, film_first):
    """A catheter a quarter of a millimetre from the wall, and a sphere that is followed too."""
    off_m = small_scene.duct.radius_m - 0.5 * small_scene.duct.thickness_m - 0.25e-3
    catheter = replace(small_scene.catheter, anchor="free", length_m=20e-3, n_segments=10)
    height_m = off_m - 0.5 * catheter.outer_diameter_m
    catheter = replace(catheter, tip_position_m=(10e-3, -height_m * np.sin(np.pi / 12), -height_m * np.cos(np.pi / 12)))
    simulation = Simulation(replace(small_scene, catheter=catheter), small_duct)
    steps = [
        lambda: simulation.search.set_catheter_row_gap(0.4e-3),
        lambda: simulation.world.add_spheres(np.array([1e-3])),
    ]
    for step in steps if film_first else reversed(steps):
        step()
    pairs = ContactPairs.zeros(capacity=256)
    simulation.search.begin(simulation.system)
    simulation.search.write_pairs(simulation.system.address, pairs)
    particles = pairs.particle[: pairs.count]
    assert ((particles >= 0) & (particles < 10)).any()


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.5])
def test_the_normal_of_the_surface_of_jaws_is_the_gradient_of_the_clearance(simulation, small_scene, angle):
    """By moving the wall's point a little: along the piece's own normal the clearance grows more slowly, or faster."""
    tools = simulation.system.geometry.tools
    tools.frame[0], tools.segments[0, JAW_A] = np.eye(3), [[0.0, 0.0, 0.0], [0.0, 0.0, 10e-3]]
    tools.indentation[0], tools.layers[0] = 0.4e-3 * np.linspace(1.0, 0.9, N_CELLS), 2.0
    reach_m = tools.radius[0, JAW_A] + 0.5 * small_scene.duct.thickness_m

    def clearance_m(point_m):
        away_m = np.array([0.0, 0.0, point_m[2]]) - point_m
        distance_m = np.linalg.norm(away_m)
        room = overlap_in_jaws(tools, JAW_A, float(point_m[2] / 10e-3), tuple(away_m / distance_m))
        return distance_m - reach_m + room

    radial = np.array([np.cos(angle), np.sin(angle), 0.0])
    room = overlap_in_jaws(tools, JAW_A, 0.52, tuple(radial))
    at_m = np.array([0.0, 0.0, 5.2e-3]) - (reach_m - room) * radial
    assert room > 0.0
    assert clearance_m(at_m) == pytest.approx(0.0, abs=1e-12)
    gradient = [(clearance_m(at_m - way) - clearance_m(at_m + way)) / 2e-8 for way in 1e-8 * np.eye(3)]
    size = np.linalg.norm(gradient)
    _, rest_offset_m, _, normal = jaw_surface(tools, JAW_A, 0.52, tuple(radial))
    assert np.array(normal) == pytest.approx(gradient / size, abs=1e-5)
    assert rest_offset_m == pytest.approx(reach_m - (reach_m - room) / size, abs=1e-9)
