"""`trocar fem` end to end: the example files, a plate from an STL against Timoshenko, VTU and JSON."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.by_day import by_day
from tests.studies.fem_files import DUCT, changed, clamped, held, run, square, surface_case, write
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.studies.commands.fem import fem_command
from trocar.studies.fem import run as fem_run
from trocar.studies.fem.case import FemCase
from trocar.studies.fem.output import to_json
from trocar.studies.fem.run import build_load, build_mesh, build_model, solve_case
from trocar.studies.fem.select import select
from trocar.studies.published.shells import DUCT_RITZ_HZ, mapped_patch

EXAMPLES = Path(__file__).resolve().parents[2] / "configs" / "fem"


#: With --long only: by day `test_large_displacements` follows the same squeeze, and the file's model is built.
SQUEEZED = EXAMPLES / "squeezed-duct.yaml"
OTHERS = sorted({*EXAMPLES.glob("*.yaml")} - {SQUEEZED})


@pytest.mark.parametrize("path", by_day(OTHERS, [SQUEEZED]), ids=lambda p: p.stem)
def test_every_example_runs(path, tmp_path, capsys):
    result = run(path, tmp_path)
    static = result["static"] if "static" in result else result["path"]["points"][-1]
    assert static["residual"] < 1e-8
    assert min(result.get("frequency_hz", result.get("load_factor", [2.0]))) > 1.0
    assert (tmp_path / "out.vtu").stat().st_size > 1000
    assert "free dofs" in capsys.readouterr().out


@pytest.mark.parametrize("path", [*sorted((EXAMPLES / "published").glob("*.yaml")), SQUEEZED], ids=lambda p: p.stem)
def test_every_published_shell_can_be_built(path):
    """What each comes to is in benchmarks/results/published-shells.md."""
    case, _ = config.load(FemCase, path)
    mesh, _ = build_mesh(case, path.parent)
    model, imposed, _ = build_model(case, mesh)
    for name, where in case.probes.items():
        assert len(select(mesh, where, name)) >= 1
    assert build_load(case, model).ravel()[model.free_dofs].any() or imposed.any()


def test_a_cantilever_bends_as_published_at_every_load_step(tmp_path):
    """Sze, Liu and Lo 2004, 3.1: shortening and deflection at 0.2, 0.4, ... of the load."""
    published = {
        0.2: (0.381, 2.493),
        0.4: (1.184, 4.292),
        0.6: (2.002, 5.444),
        0.8: (2.705, 6.190),
        1.0: (3.286, 6.698),
    }
    points = run(EXAMPLES / "published" / "cantilever-shear.yaml", tmp_path)["path"]["points"]
    own = {round(point["part"], 6): point["probes"]["tip"] for point in points}
    for part, (shortening, deflection) in published.items():
        assert own[part][::2] == pytest.approx([-shortening, deflection], rel=0.003)


def test_pinched_example_gives_the_published_first_frequency_and_a_balanced_pinch(tmp_path):
    result = run(EXAMPLES / "pinched-duct.yaml", tmp_path)
    assert result["frequency_hz"][0] == pytest.approx(DUCT_RITZ_HZ["(1,1)"], rel=0.01)
    assert result["static"]["reaction_force_n"] == pytest.approx([0, 0, 0], abs=1e-13)
    assert result["static"]["probes"]["pinched wall"][1] < -0.5e-3


@pytest.fixture
def plate_file(tmp_path):
    """A clamped 100 mm square steel plate as an STL in millimetres."""
    trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")
    patch = mapped_patch(24, 24, lambda s, t: (100 * s, 100 * t, np.zeros_like(s)))
    trimesh.Trimesh(patch.mesh.vertices_m, patch.mesh.triangles, process=False).export(tmp_path / "plate.stl")
    edges = [
        [[-1, -1, -1], [1e-6, 1, 1]],
        [[0.1 - 1e-6, -1, -1], [1, 1, 1]],
        [[-1, -1, -1], [1, 1e-6, 1]],
        [[-1, 0.1 - 1e-6, -1], [1, 1, 1]],
    ]
    return write(
        tmp_path,
        {
            "mesh": {"surface_file": {"path": "plate.stl", "units": "mm"}},
            "thickness_m": 1e-3,
            "material": {"youngs_modulus_pa": 200e9, "poisson_ratio": 0.3, "density_kg_m3": 7800.0},
            "supports": [{"where": {"box_m": box}} for box in edges],
            "loads": [{"traction_pa": [0, 0, 1000.0]}],
            "probes": {"centre": {"near_m": [0.05, 0.05, 0.0]}},
            "modes": 3,
        },
    )


def test_a_plate_from_a_file_bends_as_timoshenko_says(plate_file, tmp_path):
    result = run(plate_file, tmp_path)
    D = 200e9 * 1e-9 / (12 * (1 - 0.3**2))
    assert result["static"]["probes"]["centre"][2] == pytest.approx(0.00126532 * 1000 * 0.1**4 / D, rel=0.01)
    omega = 35.99 / 0.1**2 * math.sqrt(D / (7800 * 1e-3))
    assert result["frequency_hz"][0] == pytest.approx(omega / (2 * math.pi), rel=0.01)
    assert result["static"]["reaction_force_n"] == pytest.approx([0, 0, -10.0], abs=1e-9)


def test_vtk_opens_the_output(plate_file, tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="the mesh extra is not installed")
    result = run(plate_file, tmp_path)
    grid = pyvista.read(tmp_path / "out.vtu")
    assert grid["displacement_m"] == pytest.approx(np.array(result["static"]["displacement_m"]))
    modes = [name for name in grid.point_data if name.startswith("mode_")]
    assert len(modes) == 3
    assert np.linalg.norm(grid[modes[0]], axis=1).max() == pytest.approx(1.0)
    assert set(grid.cell_data) == {"thickness_m", "youngs_modulus_pa"}


@pytest.mark.parametrize(("units", "is_doubted"), [("mm", False), ("cm", False), ("m", True)])
def test_a_surface_file_in_a_unit_that_makes_it_a_foil_is_solved_with_a_caution(
    plate_file, tmp_path, units, is_doubted
):
    case = yaml.safe_load(plate_file.read_text())
    case["mesh"]["surface_file"]["units"] = units
    side_m = {"mm": 0.1, "cm": 1.0, "m": 100.0}[units]
    edges = [[[-1e-6 * side_m, -1.0, -1.0], [1e-6 * side_m, 2.0 * side_m, 1.0]]]
    case["supports"] = [{"where": {"box_m": box}} for box in edges]
    case["modes"], case["probes"] = 0, {}
    cautions = run(write(tmp_path, case), tmp_path)["cautions"]
    assert any("the mesh, or thickness_m, in another unit?" in caution for caution in cautions) == is_doubted


def test_imposed_displacement_is_a_load(tmp_path):
    """Both rims moved alike: the duct moves rigidly and the supports feel nothing."""
    held = [{"where": {"vertex_set": s}, "displacement_m": [0, 1e-3, 0]} for s in ("clamped", "mouth")]
    data = run(write(tmp_path, changed(supports=held, modes=0)), tmp_path)
    assert np.array(data["static"]["displacement_m"]) == pytest.approx(np.tile([0, 1e-3, 0], (156, 1)), abs=1e-12)
    assert data["static"]["reaction_force_n"] == pytest.approx([0, 0, 0], abs=1e-12)


def test_a_later_support_on_other_dofs_leaves_an_imposed_displacement_alone(tmp_path):
    supports = [clamped(), held([0, 1e-3, 0], "uy"), held([0, 0, 0], "ux")]
    data = run(write(tmp_path, changed(supports=supports, modes=0)), tmp_path)
    assert data["static"]["displacement_m"][150][:2] == pytest.approx([0.0, 1e-3], abs=1e-15)


def test_a_wall_as_thick_as_a_third_of_its_width_is_solved_with_a_caution(tmp_path, capsys):
    thick = {"radius_m": 0.004, "length_m": 0.04, "n_around": 12, "n_along": 12}
    data = run(write(tmp_path, changed(mesh={"parametric": thick}, thickness_m=2.7e-3)), tmp_path)
    assert len(data["cautions"]) == 1
    assert "thickness is 0.34 of the width" in capsys.readouterr().out
    assert run(write(tmp_path, DUCT), tmp_path)["cautions"] == []


def test_a_displacement_that_is_not_small_is_a_caution(tmp_path):
    pull = [{"force_n": [0, 1.0, 0], "where": {"vertex_set": "mouth"}}]
    data = run(write(tmp_path, changed(loads=pull, modes=0)), tmp_path)
    assert "of the mesh's size: displacements are taken as small" in data["cautions"][0]


@pytest.mark.parametrize(("thickness_m", "is_doubted"), [(5e-5, True), (1e-3, False)])
def test_cells_wider_than_the_bent_edge_of_a_stretched_foil_are_a_caution(
    plate_file, tmp_path, thickness_m, is_doubted
):
    case = yaml.safe_load(plate_file.read_text()) | {"thickness_m": thickness_m, "analysis": "nonlinear"}
    case = {key: value for key, value in case.items() if key != "modes"} | {"load_steps": 4}
    cautions = run(write(tmp_path, case), tmp_path)["cautions"]
    assert any("where its edge is clamped" in caution for caution in cautions) == is_doubted


def test_torsion_that_drilling_freedoms_stiffen_is_a_caution(tmp_path):
    """Cells four times as wide as long on a wall a third as thick as its radius: 18 % (`test_thick_torsion`)."""
    mesh = {"parametric": {"radius_m": 0.004, "length_m": 0.024, "n_around": 24, "n_along": 96}}
    case = changed(mesh=mesh, thickness_m=4e-3 / 3)
    cautions = {
        membrane: run(write(tmp_path, case | {"elements": {"membrane": membrane}}), tmp_path)["cautions"]
        for membrane in ("cst", "andes")
    }
    assert cautions["cst"] == []
    assert "makes torsion of this wall about 19 % too stiff" in cautions["andes"][0]


def test_pressure_on_a_sheet_with_a_few_triangles_wound_apart_is_that_of_the_sheet(tmp_path):
    whole, mended = (run(surface_case(tmp_path, square(share)), tmp_path) for share in (0.0, 0.2))
    assert mended["static"]["reaction_force_n"] == pytest.approx(whole["static"]["reaction_force_n"])
    assert abs(whole["static"]["reaction_force_n"][1]) == pytest.approx(10.0)
    assert any("turned 26 triangles" in action for action in mended["mesh"]["actions"])


def test_pressure_on_a_sheet_wound_half_one_way_is_refused_with_the_place(tmp_path):
    with pytest.raises(
        ConfigError, match=r"loads.0.pressure_pa: the surface has no outward side, at \[.*\] mm two tri"
    ):
        run(surface_case(tmp_path, square(0.5)), tmp_path)
    weight = [{"acceleration_m_s2": [0, 1, 0]}]
    assert run(surface_case(tmp_path, square(0.5), loads=weight), tmp_path)["static"]["residual"] < 1e-8


def test_pressure_where_three_sheets_meet_is_refused(tmp_path):
    half = mapped_patch(4, 4, lambda s, t: (0.5 + 0 * s, 0.5 * s, t)).mesh
    flat = mapped_patch(4, 4, lambda s, t: (s, np.zeros_like(s), t)).mesh
    mesh = TriangleMesh(
        np.concatenate([flat.vertices_m, half.vertices_m]),
        np.concatenate([flat.triangles, half.triangles + flat.n_vertices]),
    )
    with pytest.raises(ConfigError, match=r"at \[500.0, 0.0, .*\] mm more than two triangles meet"):
        run(surface_case(tmp_path, mesh), tmp_path)


def test_a_closed_surface_wound_inwards_is_blown_up_by_a_pressure_not_crushed(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")
    ball = trimesh.creation.icosphere(subdivisions=2)
    probes = {"top": {"near_m": [0, 0, 1]}}
    for faces in (ball.faces, ball.faces[:, ::-1]):
        mesh = TriangleMesh(np.asarray(ball.vertices), np.asarray(faces))
        data = run(surface_case(tmp_path, mesh, probes=probes), tmp_path)
        assert data["static"]["probes"]["top"][2] > 0.0


def test_the_example_of_buckling_collapses_a_little_above_the_long_duct(tmp_path, capsys):
    """The long duct's pressure is Bresse's ring in plane strain; two held ends raise it by a few percent."""
    factors = run(EXAMPLES / "collapsing-duct.yaml", tmp_path)["load_factor"]
    long_duct_pa = 100e3 * (0.5 / 4) ** 3 / (4 * (1 - 0.45**2))
    assert 1.0 < factors[0] / long_duct_pa < 1.05
    assert factors[1] == pytest.approx(factors[0], rel=1e-6)
    assert f"{factors[0]:.6g}" in capsys.readouterr().out


def test_gravity_reaction_is_the_weight(tmp_path):
    data = run(write(tmp_path, changed(loads=[{"acceleration_m_s2": [0, 0, -9.81]}])), tmp_path)
    assert data["static"]["reaction_force_n"] == pytest.approx([0, 0, 9.81 * data["mesh"]["mass_kg"]], abs=1e-12)


def test_a_stiff_region_stiffens(tmp_path):
    pull = [{"force_n": [0, 1e-3, 0], "where": {"vertex_set": "mouth"}}]
    soft = changed(loads=pull, modes=0, probes={"mouth": {"vertex_set": "mouth"}})
    stiff = soft | {"regions": [{"centre_m": [0, 0, 0], "radius_m": 0.012, "modulus_factor": 5.0}]}
    drops = [
        to_json(solve_case(config.build(FemCase, data, "x"), tmp_path))["static"]["probes"]["mouth"][1]
        for data in (soft, stiff)
    ]
    assert drops[1] < 0.9 * drops[0]


def test_penalty_and_elimination_agree(tmp_path):
    pull = [{"force_n": [0, 1e-3, 0], "where": {"vertex": 150}}]
    first, second = (
        run(write(tmp_path, changed(loads=pull, constraints=c)), tmp_path) for c in ("elimination", "penalty")
    )
    assert second["static"]["largest_displacement_m"] == pytest.approx(
        first["static"]["largest_displacement_m"], rel=1e-5
    )


def test_stages_are_reported_in_order(tmp_path):
    stages = []
    solve_case(config.build(FemCase, DUCT, "x"), tmp_path, lambda stage, steps: stages.append(stage))
    assert [stage for stage in stages if stage] == ["mesh", "assembly", "factors", "modes"]
    assert stages.count("") >= 4


def test_each_support_says_its_force(tmp_path, capsys):
    """A tube pulled by 1 % between ends that may narrow: E A of its cross-section's polygon times the strain."""
    ends = [
        {"where": {"vertex_set": "clamped"}, "dofs": ["ux"]},
        {"where": {"vertex_set": "mouth"}, "dofs": ["ux"], "displacement_m": [4e-4, 0, 0]},
        {"where": {"vertex": 0}, "dofs": ["uy", "uz"]},
        {"where": {"vertex": 3}, "dofs": ["uy"]},
    ]
    result = run(write(tmp_path, changed(supports=ends, modes=0)), tmp_path)
    girth_m = 12 * 2 * 0.004 * np.sin(np.pi / 12)
    pull_n = 1e5 * 0.5e-3 * girth_m * 0.01
    forces = np.array(result["static"]["support_force_n"])
    np.testing.assert_allclose(forces, np.outer([-pull_n, pull_n, 0, 0], [1, 0, 0]), atol=1e-9 * pull_n)
    assert "supports.1: force 0.0124233 0 0 N" in capsys.readouterr().out


def squeezed(**changes):
    jaws = [[0.039, 0.0039, -1e-6], [0.041, 0.0041, 1e-6]], [[0.039, -0.0041, -1e-6], [0.041, -0.0039, 1e-6]]
    moves = [[0.0, -0.001, 0.0], [0.0, 0.001, 0.0]]
    supports = [
        {"where": {"box_m": box}, "dofs": ["uy"], "displacement_m": by} for box, by in zip(jaws, moves, strict=True)
    ]
    case = changed(
        supports=[clamped(), *supports],
        analysis="nonlinear",
        load_steps=2,
        probes={"side": {"near_m": [0.04, 0.0, 0.004]}},
    )
    return {key: value for key, value in (case | changes).items() if key != "modes"}


def test_nonlinear_path_is_written_point_by_point(tmp_path, capsys):
    meshio = pytest.importorskip("meshio", reason="the mesh extra is not installed")
    path = run(write(tmp_path, squeezed()), tmp_path)["path"]
    assert [point["part"] for point in path["points"]] == [0.5, 1.0]
    upper, lower = path["points"][-1]["support_force_n"][1:]
    assert upper[1] == pytest.approx(-lower[1], rel=1e-6)
    assert lower[1] > 0.0
    assert path["points"][-1]["probes"]["side"][2] > path["points"][0]["probes"]["side"][2] > 0.0
    assert "supports.1: force" in capsys.readouterr().out
    last = meshio.read(tmp_path / "out-0002.vtu").point_data["displacement_m"]
    assert last == pytest.approx(np.array(path["displacement_m"]))
    assert (tmp_path / "out.pvd").read_text().count("<DataSet") == 3


def nothing():
    return {"force_n": [0.0, 0.0, 0.0], "where": {"vertex": 40}}


def test_a_path_along_its_length_of_many_steps_has_as_many_points_as_it_takes(tmp_path, monkeypatch):
    """No step of it is longer than a load step: 20 of these take more than 10 points."""
    monkeypatch.setattr(fem_run, "MOST_POINTS", 10)
    case = squeezed(load_steps=20, path="arc_length")
    assert run(write(tmp_path, case), tmp_path)["path"]["points"][-1]["part"] == 1.0


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"analysis": "linear"}, "load_steps goes with analysis: nonlinear"),
        ({"buckling": 1}, "buckling is a linear analysis"),
        ({"constraints": "penalty"}, "goes with constraints: elimination"),
        ({"supports": [clamped()]}, "nothing to solve"),
        ({"load_steps": 0}, "load_steps"),
        ({"supports": [clamped()], "loads": [nothing()]}, "loads: add up to nothing"),
        ({"supports": [clamped()], "loads": [nothing()], "path": "arc_length"}, "loads: add up to nothing"),
        (
            {"supports": [clamped()], "loads": [{"force_n": [0.0, 1.0, 0.0], "where": {"vertex_set": "clamped"}}]},
            "loads: act only where supports hold them",
        ),
    ],
)
def test_what_does_not_go_with_a_nonlinear_analysis_is_refused(tmp_path, changes, sentence):
    with pytest.raises(ConfigError, match=sentence):
        fem_command(write(tmp_path, squeezed(**changes)))


def test_a_moment_bends_a_strip_to_the_beam_s_curvature(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")
    patch = mapped_patch(20, 2, lambda s, t: (100 * s, 10 * t, np.zeros_like(s)))
    trimesh.Trimesh(patch.mesh.vertices_m, patch.mesh.triangles, process=False).export(tmp_path / "strip.stl")
    stiffness = 1e9 * 0.01 * 0.001**3 / 12
    case = {
        "mesh": {"surface_file": {"path": "strip.stl", "units": "mm"}},
        "thickness_m": 0.001,
        "material": {"youngs_modulus_pa": 1e9, "poisson_ratio": 0.0, "density_kg_m3": 1000.0},
        "supports": [{"where": {"box_m": [[-1e-6, -1, -1], [1e-6, 1, 1]]}}],
        "loads": [
            {"moment_n_m": [0.0, -np.pi * stiffness / 0.1, 0.0], "where": {"box_m": [[0.0999, -1, -1], [0.1001, 1, 1]]}}
        ],
        "analysis": "nonlinear",
        "probes": {"tip": {"box_m": [[0.0999, -1, -1], [0.1001, 1, 1]]}},
    }
    tip = run(write(tmp_path, case), tmp_path)["path"]["points"][-1]["probes"]["tip"]
    assert tip == pytest.approx([-0.1, 0.0, 0.2 / np.pi], abs=3e-4)


def test_a_plate_that_nothing_holds_has_its_rigid_motions_at_nothing(tmp_path, capsys):
    found = run(surface_case(tmp_path, square(0.0), supports=[], loads=[], modes=8, thickness_m=0.01), tmp_path)
    assert found["frequency_hz"][:6] == [0.0] * 6
    assert found["frequency_hz"][6] > 0.0
    assert "the supports leave 6 rigid motions: they are the first modes, at 0 Hz" in capsys.readouterr().out


def test_forces_on_a_rim_that_stiff_drilling_freedoms_bend_are_cautioned(tmp_path):
    """By 6 (l phi / 8) / t of the membrane's stress; not where rotations are held, nor with the other membrane."""
    thin = {"parametric": {"radius_m": 0.1, "length_m": 0.2, "n_around": 32, "n_along": 10}}
    pull = {"force_n": [1.0, 0.0, 0.0], "where": {"vertex_set": "mouth"}}

    def cautions(membrane, load):
        case = changed(
            mesh=thin, thickness_m=1e-3, loads=[load], modes=0, elements={"membrane": membrane, "bending": "dkt"}
        )
        return run(write(tmp_path, case), tmp_path)["cautions"]

    said = cautions("andes", pull)
    edge_m, angle = 2.0 * 0.1 * np.sin(np.pi / 32), 2.0 * np.pi / 32
    assert len(said) == 1
    assert f"{edge_m * angle / 8.0 / 1e-3:.2g} of the thickness beside the wall" in said[0]
    assert cautions("cst", pull) == []
    assert cautions("andes", {"acceleration_m_s2": [1.0, 0.0, 0.0]}) == []
