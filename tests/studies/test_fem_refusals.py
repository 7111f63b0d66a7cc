"""`trocar fem` refuses what cannot be solved: one sentence with file, key or place."""

import numpy as np
import pytest
from scipy.sparse.linalg import ArpackNoConvergence

from tests.studies.fem_files import DUCT, changed, clamped, held, run, square, surface_case, write
from trocar.services.runtime.errors import ConfigError
from trocar.studies.commands.fem import fem_command
from trocar.studies.fem import run as fem_run


@pytest.mark.parametrize("key", ["modes", "buckling"])
def test_an_iteration_that_gives_up_is_one_sentence(tmp_path, monkeypatch, key):
    def give_up(*args):
        raise ArpackNoConvergence("no convergence", np.ones(1), np.ones((3, 1)))

    monkeypatch.setattr(fem_run, f"compute_{key}", give_up)
    with pytest.raises(ConfigError, match=f"case.yaml: {key}: the iteration gave up with 1 found to rounding"):
        run(write(tmp_path, changed(loads=[{"pressure_pa": -1.0}], modes=0) | {key: 3}), tmp_path)


def test_a_surface_too_large_to_solve_is_refused_before_it_is_looked_at(tmp_path, monkeypatch):
    path = surface_case(tmp_path, square(0.0), loads=[{"pressure_pa": 1.0}])
    monkeypatch.setattr("trocar.services.mechanics.fem.memory.free_bytes", lambda: 1000.0)
    monkeypatch.setattr(fem_run, "merge_and_drop", lambda *_: pytest.fail("it was looked at"))
    with pytest.raises(ConfigError, match=r"vertices take about .* GB to solve, .* GB are free: use larger triangles"):
        fem_command(path)


def test_a_path_keeps_its_name_whatever_it_holds_of_the_solver_s_words(tmp_path):
    folder = tmp_path / "n_modes"
    folder.mkdir()
    (folder / "wall_thickness_m.obj").write_text("")
    path = write(tmp_path, DUCT | {"mesh": {"surface_file": {"path": "n_modes/wall_thickness_m.obj", "units": "m"}}})
    with pytest.raises(ConfigError, match=r"n_modes/wall_thickness_m\.obj"):
        fem_command(path)


@pytest.mark.parametrize("text", ["", "# only a comment\n", "---\n"])
def test_a_file_that_says_nothing_is_told_so(tmp_path, text):
    path = tmp_path / "empty.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"empty.yaml: mesh: this key is missing .*; nothing is in the file"):
        fem_command(path)


EVERYWHERE = {"where": {"box_m": [[-1, -1, -1], [1, 1, 1]]}}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"thicknes_m": 1}, r"case.yaml: thicknes_m: unknown key 'thicknes_m'; known: .*thickness_m"),
        ({"thickness_m": -1}, "case.yaml: thickness_m: .* greater than 0"),
        ({"thickness_m": True}, "case.yaml: thickness_m: input should be a valid number"),
        ({"thickness_m": "0.001"}, "case.yaml: thickness_m: input should be a valid number"),
        ({"thickness_m": 1e-300}, "case.yaml: thickness_m: must not be smaller than 1e-30, is 1e-300"),
        ({"loads": [{"pressure_pa": 0.0}], "buckling": 1}, "case.yaml: buckling: the loads stress this shell nowhere"),
        (
            {"regions": 12 * [{"centre_m": [0, 0, 0], "radius_m": 1, "modulus_factor": 1e30}]},
            "case.yaml: material: youngs_modulus_pa must be positive everywhere",
        ),
        ({"supports": [EVERYWHERE]}, "case.yaml: modes: cannot be had, the supports leave 0 translations free"),
        (
            {"supports": [EVERYWHERE], "loads": [{"pressure_pa": 1.0}], "modes": 0, "buckling": 1},
            "case.yaml: buckling: the supports leave 0 dofs free",
        ),
        (
            {"loads": [{"pressure_pa": -1e300}]},
            r"case.yaml: loads.0.pressure_pa: must not be larger than 1e\+30, is -1e\+300",
        ),
        (
            {"mesh": {"parametric": {"radius_m": 1e300, "length_m": 0.04}}},
            r"case.yaml: mesh.parametric.radius_m: must not be larger than 1e\+30",
        ),
        (
            {
                "mesh": {"parametric": {"radius_m": 0.004, "length_m": 0.04, "n_around": 8, "n_along": 4}},
                "loads": [{"pressure_pa": 1e9}],
                "analysis": "nonlinear",
                "load_steps": 1,
            },
            "where a shell snaps, path: arc_length follows it",
        ),
        (
            {"mesh": {}},
            "case.yaml: mesh: give exactly one of parametric, plate, annulus, cylinder, sphere, duct_file, "
            "surface_file, not none",
        ),
        (
            {"mesh": {"annulus": {"inner_radius_m": 2.0, "outer_radius_m": 1.0, "n_around": 8, "n_across": 2}}},
            "case.yaml: mesh.annulus: outer_radius_m must be above inner_radius_m, is 1",
        ),
        ({"mesh": {"parametric": {"radius_m": 1e-3}}}, "mesh.parametric.length_m: this key is missing"),
        (
            {"mesh": {"parametric": {"radius_m": 1e-3, "length_m": 1, "taper": 0.9}}},
            "case.yaml: mesh.parametric: thickness_m leaves no lumen",
        ),
        ({"mesh": {"duct_file": {"path": "no.stl", "units": "mm"}}}, "no.stl: no such file"),
        (
            {"mesh": {"duct_file": {"path": "no.stl", "units": "furlong"}}},
            "case.yaml: mesh.duct_file.units: input should be 'm', 'cm', 'mm', 'um' or 'in'",
        ),
        (
            {"mesh": {"parametric": {"radius_m": 0.004, "length_m": 0.04, "n_around": 9999, "n_along": 9999}}},
            r"case.yaml: mesh.parametric: n_around times n_along make 2e\+08 triangles",
        ),
        ({"supports": [], "loads": [{"traction_pa": [1.0, 0, 0]}]}, "case.yaml: supports: .* rigidly in 6 of 6 ways"),
        ({"supports": [{"where": {"vertex": 3}}]}, None),
        (
            {"supports": [{"where": {"vertex": 3}, "dofs": ["ux"]}], "loads": [{"traction_pa": [1.0, 0, 0]}]},
            "case.yaml: supports: .* rigidly in 5 of 6 ways",
        ),
        ({"supports": [{"where": {"vertex": 9999}}]}, r"supports.0.where.vertex: 9999 does not exist"),
        (
            {"supports": [{"where": {"vertex_set": "rim"}}]},
            "vertex_set: the mesh has no vertex set 'rim'; it has: clamped",
        ),
        ({"supports": [{"where": {"box_m": [[1, 1, 1], [2, 2, 2]]}}]}, "box_m: holds no vertex; the mesh spans"),
        ({"supports": [{"where": {"vertex": 1, "vertex_set": "mouth"}}]}, "give exactly one of vertex_set, vertex"),
        ({"loads": [{"force_n": [1, 0, 0]}]}, "'where' goes with force_n"),
        ({"loads": [{"pressure_pa": ".inf"}]}, "loads.0.pressure_pa"),
        ({"modes": 0}, "nothing to solve"),
        ({"buckling": 2}, "buckling needs loads or a displacement_m in supports"),
        (
            {"loads": [{"force_n": [1e-3, 0, 0], "where": {"vertex_set": "mouth"}}], "buckling": 1},
            "case.yaml: buckling: no multiple of the loads buckles this shell",
        ),
        ({"modes": 100000}, "case.yaml: modes: must lie between 1 and"),
        ({"regions": [{"centre_m": [9, 9, 9], "radius_m": 1e-3}]}, "regions.0: no triangle"),
        ({"elements": {"bending": "mitc"}}, "elements.bending: .*'dkt', 'dkmt', 'reissner' or 'tocher'"),
        (
            {"material": {"youngs_modulus_pa": 1e5, "poisson_ratio": 0.7, "density_kg_m3": 1.0}},
            "case.yaml: material: poisson_ratio of an isotropic material must not exceed 0.5",
        ),
        (
            {"supports": [clamped(), held([0, 1e-3, 0]), held([0, 0, 0], "ux", "uz", "uy")]},
            r"supports.2.displacement_m: uy of vertex 150 at \[.*\] mm is held at 0.0 m here and at 0.001 m by supp",
        ),
        (
            {"supports": [clamped(), held([0, 0, 0], "uy"), held([0, 1e-3, 0])]},
            r"supports.2.displacement_m: uy of vertex 150 .* at 0.001 m here and at 0.0 m by supports.1",
        ),
        (
            {"supports": [clamped(), held([0, 1e-3, 0], "ux")]},
            "supports.1.displacement_m: uy is moved by 0.001 m, but dofs does not hold it",
        ),
        (
            {"probes": {"p": {"near_m": [40.0, 0.004, 0]}}, "loads": [{"pressure_pa": 1.0}]},
            r"probes.p.near_m: the nearest vertex, \d+ at \[40.0, .* mm, is 3.996e\+04 mm away, further than the",
        ),
        (
            {"thickness_m": 0.5e-3, "regions": [{"centre_m": [0, 0, 0], "radius_m": 1, "thickness_factor": 40}]},
            r"case.yaml: thickness_m: is 2.5\d? times the width of the piece round \[20.0, .*\] mm, that is no shell",
        ),
        ({"probes": {"p": {"vertex": 5000}}, "loads": [{"pressure_pa": 1.0}]}, "probes.p.vertex: 5000 does not exist"),
    ],
)
def test_a_wrong_file_is_one_sentence_with_its_key(tmp_path, change, message):
    path = write(tmp_path, changed(**change))
    if message is None:
        run(path, tmp_path)
        return
    with pytest.raises(ConfigError, match=message) as caught:
        run(path, tmp_path)
    assert "\n" not in str(caught.value)


def test_where_all_is_held_all_of_the_load_is_reaction(tmp_path):
    load = {"force_n": [1.0, 2.0, 3.0], "where": {"vertex_set": "mouth"}}
    found = run(write(tmp_path, changed(supports=[EVERYWHERE], loads=[load], modes=0)), tmp_path)["static"]
    assert found["reaction_force_n"] == pytest.approx([-1.0, -2.0, -3.0])
    assert found["largest_displacement_m"] == 0.0


@pytest.mark.parametrize("analysis", ["linear", "nonlinear"])
def test_a_probe_may_have_any_name(tmp_path, capsys, analysis):
    """Brackets in it were markup of the terminal, and one that closes nothing a traceback."""
    name = "[/wall] [bold]upper"
    case = changed(loads=[{"pressure_pa": 1.0}], probes={name: {"vertex": 150}}, modes=0, analysis=analysis)
    found = run(write(tmp_path, case), tmp_path)
    shown = capsys.readouterr().out
    assert all(word in shown for word in name.split())
    assert name in (found["static"] if analysis == "linear" else found["path"]["points"][-1])["probes"]


def test_a_surface_of_nothing_is_refused_with_its_file(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    mesh = {"surface_file": {"path": "flat.obj", "units": "mm"}}
    with pytest.raises(ConfigError, match=r"case.yaml: .*flat.obj: surface has no triangle with an area"):
        run(write(tmp_path, changed(mesh=mesh)), tmp_path)


def test_a_surface_at_infinity_is_one_sentence(tmp_path):
    (tmp_path / "far.obj").write_text("v 0 0 1e300\nv 10 0 0\nv 0 10 0\nf 1 2 3\n")
    mesh = {"surface_file": {"path": "far.obj", "units": "mm"}}
    with pytest.raises(ConfigError, match=r"far.obj: vertex 0 is 1e\+297 m from the origin"):
        fem_command(write(tmp_path, changed(mesh=mesh)))


def test_output_into_a_missing_folder_is_refused_before_solving(tmp_path):
    with pytest.raises(ConfigError, match=r"--json .*: there is no folder"):
        fem_command(write(tmp_path, DUCT), tmp_path / "absent" / "x.json")
