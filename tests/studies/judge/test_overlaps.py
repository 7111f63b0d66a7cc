"""What the judge of overlaps says of bodies laid into each other by hand, and that ordinary play crosses nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import ipctk
import numpy as np
import pytest

from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.effects.self_contact import SelfContactSettings
from trocar.services.mechanics.scenarios import insertion, insertion_scene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.judge.overlaps import OverlapJudge, pose_tools

RADIUS_M, HALF_WALL_M = 4e-3, 0.5e-3


@pytest.fixture
def simulation(own_cache: Path) -> Simulation:
    scene = insertion_scene()
    scene = replace(scene, duct=replace(scene.duct, n_around=24, n_along=20, n_modes=20))
    return Simulation(scene, build_scene_duct(scene, own_cache))


def lay(simulation: Simulation, heights_m: tuple[float, float]) -> None:
    """Lay the catheter along +x in the duct, particles at these heights over its axis by turns, in a vertex' plane."""
    line = simulation.catheter.state.position_m
    line[:, 0], line[:, 1] = np.linspace(5e-3, 30e-3, len(line)), 0.0
    line[:, 2] = np.resize(heights_m, len(line))


def test_a_catheter_on_the_axis_touches_nothing(simulation: Simulation) -> None:
    lay(simulation, (0.0, 0.0))
    assert max(OverlapJudge(simulation).look().values()) == 0.0


def test_a_catheter_under_a_line_of_vertices_is_as_deep_as_its_facets_say(simulation: Simulation) -> None:
    """Facets beside the line lean by half an edge's angle towards the catheter: they are nearer by its cosine."""
    depth_m, radius_m = 0.1e-3, simulation.catheter.radius_m
    line = simulation.duct.reduced.mesh.vertices_m
    top_m = line[np.abs(line[:, 1]) < 1e-9, 2].max()
    lay(simulation, (top_m - HALF_WALL_M - radius_m + depth_m,) * 2)
    found, reach_m = OverlapJudge(simulation).look(), radius_m + HALF_WALL_M
    expected_m = reach_m - (reach_m - depth_m) * np.cos(np.pi / 24)
    assert found["catheter"] == pytest.approx(expected_m, rel=1e-6)
    assert found["particles"] == pytest.approx(expected_m, rel=1e-6)


def test_a_segment_that_dips_into_the_wall_between_its_ends_is_seen(simulation: Simulation) -> None:
    """Two particles on either side of the axis' height, the wall bent towards the middle between them."""
    line = simulation.catheter.state.position_m
    lay(simulation, (0.0, 0.0))
    line[:, 0] = 200e-3  # away, but for one long segment that is a chord through a curve of the wall
    line[0], line[1] = (20e-3, -3.4e-3, -2.0e-3), (20e-3, 3.4e-3, -2.0e-3)
    line[2:, 1] = np.linspace(0.0, 0.1, len(line) - 2)
    found = OverlapJudge(simulation).look()
    assert found["catheter"] >= found["particles"]
    line[0], line[1] = (20e-3, 5.0e-3, 1.0e-3), (20e-3, -5.0e-3, 1.0e-3)
    found = OverlapJudge(simulation).look()
    through_m = simulation.catheter.radius_m + HALF_WALL_M
    assert found["catheter"] == pytest.approx(through_m)  # it passes through the middle surface
    assert found["particles"] < 0.9 * through_m


def test_jaws_that_leave_the_wall_half_its_room_have_squeezed_the_rest_away(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    tools, poses = simulation.tools, simulation.tools.segments.copy()
    monkeypatch.setattr("trocar.studies.judge.overlaps.pose_tools", lambda _, out: out.__setitem__(slice(None), poses))
    tools.present[:], tools.disengaged[:] = (False, True), False
    top_m, radius_m = RADIUS_M, float(tools.radius_m[1, 1])
    for jaw, side in ((1, 1.0), (2, -1.0)):
        away_m = radius_m + 0.5 * HALF_WALL_M
        poses[1, jaw] = [(18e-3, 0.0, top_m + side * away_m), (22e-3, 0.0, top_m + side * away_m)]
    poses[1, 0] = (20e-3, 0.0, 60e-3)
    lay(simulation, (-1e-3, -1e-3))
    assert OverlapJudge(simulation).look()["jaws"] < 0.03e-3
    poses[1, 2] += (0.0, 0.0, -2e-3)  # one jaw alone squeezes nothing
    assert OverlapJudge(simulation).look()["jaws"] == pytest.approx(0.5 * HALF_WALL_M, abs=0.03e-3)
    poses[1, 1:] = [(20e-3, 0.0, 10e-3), (20e-3, 0.0, 12e-3)]
    poses[1, 0] = [(20e-3, 0.0, 60e-3), (20e-3, 0.0, top_m + HALF_WALL_M + tools.radius_m[1, 0] - 0.1e-3)]
    found = OverlapJudge(simulation).look()
    assert found["shaft"] == pytest.approx(0.1e-3, abs=0.03e-3)
    assert found["jaws"] == 0.0


def test_a_tool_is_where_the_step_has_left_it(simulation: Simulation) -> None:
    """The tool body's own poses are those that the step began with."""
    tools, inputs = simulation.tools, ToolInputs()
    simulation.step(inputs)
    poses = np.empty_like(tools.segments)
    tools.proxy[:] = (30e-3, 2e-3, 40e-3, 0.5), (10e-3, 0.0, 50e-3, 0.3)
    tools.roll_rad[:] = 0.7, -0.2
    pose_tools(tools, poses)
    assert not np.allclose(poses, tools.segments)
    tools.update_pose()
    np.testing.assert_array_equal(poses, tools.segments)


def test_strands_and_stones_are_judged_where_a_scene_has_them(own_cache: Path) -> None:
    stones = GallstonesSettings(((20e-3, 0.0, 0.0),), (1.5e-3,))
    scene = replace(insertion_scene(), effects={"gallstones": stones, "self_contact": SelfContactSettings()})
    scene = replace(scene, duct=replace(scene.duct, n_around=24, n_along=20, n_modes=20))
    simulation = Simulation(scene, build_scene_duct(scene, own_cache))
    line, radius_m = simulation.catheter.state.position_m, simulation.catheter.radius_m
    line[:] = np.linspace((60e-3, 0.0, 0.0), (160e-3, 0.0, 0.0), len(line))
    assert max(OverlapJudge(simulation).look().values()) == 0.0
    line[0], line[1] = (15e-3, 0.0, 1.5e-3 + radius_m - 0.2e-3), (25e-3, 0.0, 1.5e-3 + radius_m - 0.2e-3)
    assert OverlapJudge(simulation).look()["stones"] == pytest.approx(0.2e-3)
    line[0], line[1] = (70e-3, -5e-3, 2.0 * radius_m - 0.1e-3), (70e-3, 5e-3, 2.0 * radius_m - 0.1e-3)
    found = OverlapJudge(simulation).look()
    assert found["stones"] == 0.0
    assert found["strands"] == pytest.approx(0.1e-3)


def test_in_ordinary_play_no_body_crosses_the_wall(own_cache: Path) -> None:
    """Wall and catheter as one collision mesh of the IPC Toolkit, every 100 ms of the insertion."""
    scenario = insertion()
    simulation, tools = Simulation(scenario.scene, build_scene_duct(scenario.scene, own_cache)), ToolInputs()
    triangles = simulation.duct.reduced.mesh.triangles
    n, m = simulation.duct.reduced.mesh.n_vertices, len(simulation.catheter.state.position_m)
    segments = n + np.stack([np.arange(m - 1), np.arange(1, m)], axis=1)
    edges = np.concatenate([ipctk.edges(triangles), segments])
    mesh = None
    for tick in range(round(scenario.duration_s * 1e3)):
        scenario.write_inputs(1e-3 * (tick + 1), tools)
        simulation.step(tools)
        if tick % 100 == 0:
            points = np.concatenate([simulation.duct.surface_m(), simulation.catheter.state.position_m])
            mesh = mesh or ipctk.CollisionMesh(points, edges, triangles)
            assert not ipctk.has_intersections(mesh, points), tick
