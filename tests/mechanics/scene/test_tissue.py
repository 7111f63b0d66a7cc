"""Tissue presets reproduce the distension they are read from, and say what is assumed."""

import numpy as np
import pytest

from trocar.services.mechanics.effects.anisotropy import AnisotropySettings
from trocar.services.mechanics.fem import ElementChoice, ShellModel, Support, clamp, pressure_load
from trocar.services.mechanics.fem.frames import local_frames
from trocar.services.mechanics.fem.section import plane_stress_matrices
from trocar.services.mechanics.scene.tissue import TISSUES, tissue
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.messages.sourced_value import assumed_value


@pytest.mark.parametrize("name", TISSUES)
def test_every_preset_makes_a_stable_section_and_series(name):
    preset = tissue(name)
    mesh = parametric_duct(DuctGeometry(4e-3, 20e-3, 12, 8))
    D = plane_stress_matrices(preset.section(np.array([1.0, 0.0, 0.0])), local_frames(mesh))
    assert np.linalg.eigvalsh(D).min() > 0.0
    assert 0.0 < preset.prony_series().relaxation(np.array([1e6]))[0] < 1.0


def test_moduli_are_those_of_the_directions():
    preset = tissue("porcine_common_bile_duct")
    mesh = parametric_duct(DuctGeometry(4e-3, 20e-3, 48, 8))
    frames = local_frames(mesh)
    compliance = np.linalg.inv(plane_stress_matrices(preset.section(np.array([1.0, 0.0, 0.0])), frames))
    for direction, modulus in (("axial", 45.3e3), ("round", 260e3)):
        component = np.abs(frames[:, :2] @ [1.0, 0.0, 0.0])
        c = component[:, 0] if direction == "axial" else component[:, 1]
        aligned = np.flatnonzero((c > 0.999) | (c < 0.001))
        index = np.where(c[aligned] > 0.5, 0, 1)
        assert aligned.size
        assert 1.0 / compliance[aligned, index, index] == pytest.approx(modulus, rel=0.02)


def test_pressure_widens_the_porcine_duct_less_than_it_lengthens_it():
    """Duch, with closed ends: 5 kPa lengthens by 25 % and widens by 8 %."""
    preset = tissue("porcine_common_bile_duct")
    mesh = parametric_duct(DuctGeometry(4.3e-3, 24.4e-3, 24, 20, wall_thickness_m=0.8e-3))
    mouth = mesh.vertex_sets["mouth"]
    slides = Support(mesh.vertex_sets["clamped"], ("ux", "rx"))
    pinned = [Support(np.array([0]), ("uz",)), Support(np.array([6]), ("uy",)), Support(np.array([12]), ("uz",))]
    model = ShellModel(
        mesh, preset.section(np.array([1.0, 0.0, 0.0])), [slides, *pinned], ElementChoice("andes", "dkt")
    )
    load = pressure_load(mesh, 5e3)
    load[mouth, 0] += 5e3 * np.pi * 4.3e-3**2 / mouth.size
    u = model.solve_static(load).displacement_m
    longer = u[mouth, 0].mean() / 24.4e-3
    ring = np.flatnonzero(np.abs(mesh.vertices_m[:, 0] - 12.2e-3) < 1e-4)
    wider = np.mean(np.einsum("ni,ni->n", u[ring, 1:], mesh.vertices_m[ring, 1:])) / 4.3e-3**2
    print(f"at 5 kPa: {longer:.1%} longer (25 %), {wider:.1%} wider (8 %)")
    assert (longer, wider) == pytest.approx((0.25, 0.08), rel=0.03)
    assert (longer, wider) == pytest.approx(preset.stretched(5e3, 4.3e-3), rel=0.03)


@pytest.mark.parametrize("name", [name for name, preset in TISSUES.items() if preset.distension])
def test_a_preset_stretches_as_the_tubes_it_was_read_from(name):
    preset, seen = TISSUES[name], TISSUES[name].distension
    assert preset.stretched(seen.pressure_pa, seen.radius_m) == pytest.approx((seen.along, seen.around), rel=0.01)


def test_a_wall_that_is_alike_both_ways_stretches_as_the_closed_form():
    preset = tissue("reference_duct")
    tension_pa = 1e3 * 4e-3 / 0.5e-3
    along, around = preset.stretched(1e3, 4e-3)
    assert along == pytest.approx(tension_pa * (0.5 - 0.45) / 100e3)
    assert around == pytest.approx(tension_pa * (1.0 - 0.5 * 0.45) / 100e3)


def test_the_defaults_of_anisotropy_are_the_measured_ducts():
    wall, usual = tissue("porcine_common_bile_duct"), AnisotropySettings()
    assert usual.modulus_ratio == pytest.approx(wall.modulus_ratio, rel=1e-3)
    assert usual.shear_modulus_ratio == pytest.approx(wall.shear_modulus_ratio, rel=2e-3)
    assert usual.poisson_ratio == pytest.approx(wall.axial_poisson_ratio, rel=1e-3)


def test_what_is_assumed_is_named():
    quantities = tissue("reference_duct").quantities()
    assumptions = {name: quantity for name, quantity in quantities.items() if quantity.assumed}
    assert "axial_modulus_pa" in assumptions
    assert "relaxation_times_s[2]" in assumptions
    assert all("assum" in quantity.source for quantity in assumptions.values())


def test_unknown_names_and_values_out_of_range_are_refused():
    with pytest.raises(ValueError, match="unknown tissue 'liver'; known: reference_duct"):
        tissue("liver")
    with pytest.raises(ValueError, match=r"2\.0 is outside its own range"):
        assumed_value(2.0, 0.0, 1.0, "nobody")


def test_clamped_orthotropic_duct_is_softer_along_than_round():
    mesh = parametric_duct(DuctGeometry(4e-3, 30e-3, 16, 16))
    section = tissue("porcine_common_bile_duct").section(np.array([1.0, 0.0, 0.0]))
    model = ShellModel(mesh, section, [clamp(mesh)], ElementChoice("andes", "dkt"))
    pull = np.zeros((mesh.n_vertices, 3))
    pull[mesh.vertex_sets["mouth"], 0] = 1e-3 / 16
    stretch = model.solve_static(pull).displacement_m[mesh.vertex_sets["mouth"], 0].mean()
    assert stretch == pytest.approx(1e-3 * 30e-3 / (45.3e3 * 0.8e-3 * 2.0 * np.pi * 4e-3), rel=0.05)
