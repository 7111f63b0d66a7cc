"""The guide wire of a scene's catheter: its place, and the rod's properties that follow from it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.rod import ImplicitIntegrator, RodProperties, RodState, RoundTube, Supports
from trocar.services.mechanics.rod.guide_wire import GuideWireModel, Place, stored_energies, write_rod_properties
from trocar.services.mechanics.rod.integrator import RodIntegrator
from trocar.services.mechanics.rod.material_frame import initial_frame
from trocar.services.mechanics.scene import CatheterScene, GuideWireScene

if TYPE_CHECKING:
    from trocar.services.mechanics.rod.material_frame import Frame

_FAR_M = 100.0  # longer than any wire
# Steps to rest: so long that inertia is negligible; at rest when no particle moves further than `_RESTING_M` in one.
_SLOW_S, _RESTING_M, _MOST_STEPS = 1.0, 1e-12, 1000


def wire_tube(wire: GuideWireScene) -> RoundTube:
    """Return section and material of a guide wire."""
    return RoundTube(wire.outer_diameter_m, 0.0, wire.youngs_modulus_pa, wire.density_kg_m3, wire.poisson_ratio)


def with_wire(rod: RodProperties, wire: GuideWireScene, n_beyond: int) -> RodProperties:
    """Return a catheter's properties with the wire's mass in it, and ``n_beyond`` segments of wire beyond its tip.

    Their stiffness is that of the wire's body; `GuideWire` writes what follows from its place.
    """
    tube = wire_tube(wire).rod(2, 1.0, twist=True)

    def joined(own: FloatArray, name: str, *, adds: bool = False) -> FloatArray:
        beyond = tube.per_segment(name)[0]
        return np.concatenate([own + beyond if adds else own, np.full((n_beyond, *own.shape[1:]), beyond)])

    def per_end(name: str) -> FloatArray:
        return joined(rod.per_end(name), name)

    def per_segment(name: str, *, adds: bool = False) -> FloatArray:
        return joined(rod.per_segment(name), name, adds=adds)

    bent = rod.rest_curvature_1_m
    return replace(
        rod,
        n_segments=rod.n_segments + n_beyond,
        length_m=rod.segment_length_m * (rod.n_segments + n_beyond),
        axial_stiffness_n=per_segment("axial_stiffness_n"),
        bending_stiffness_n_m2=per_end("bending_stiffness_n_m2"),
        linear_density_kg_m=per_segment("linear_density_kg_m", adds=True),
        torsional_stiffness_n_m2=per_end("torsional_stiffness_n_m2"),
        rest_curvature_1_m=None if bent is None else np.concatenate([bent, np.zeros((n_beyond, 3))]),
    )


class GuideWire:
    """Place of the wire, and the rod's arrays that depend on it.

    Attributes:
        place_array: (2,) float64. Length of wire beyond the tip, in m, and its roll relative to the catheter, in rad.
        catheter_rest: (n - 2, 3) float64. Rest rotation of the catheter's own joints, in rad, which steering changes.
    """

    def __init__(
        self, scene: CatheterScene, properties: RodProperties, integrator: RodIntegrator, state: RodState
    ) -> None:
        wire, c, model, twist = scene.guide_wire, scene.n_segments, integrator.model, integrator.twist
        assert wire is not None
        assert twist is not None
        own = properties.per_end("bending_stiffness_n_m2"), properties.per_end("torsional_stiffness_n_m2")
        half_m = 0.5 * properties.segment_length_m
        bending, torsion = (
            np.append(1.0 / (half_m / each[: c - 1, 1] + half_m / each[1:c, 0]), each[c - 1, 1] / half_m)
            for each in own
        )
        tube, drag = wire_tube(wire), properties.particle_drag_n_s_m()
        density = tube.density_kg_m3 * tube.area_m2()
        inside_kg = half_m * properties.per_segment("linear_density_kg_m")[c - 1]
        model.tip, self._rod = c, model
        twist.bending = model.joint_stiffness
        self.catheter_rest = twist.rest_rotation.copy()
        arc_m, flexibility, curvature = _sections(wire, tube)
        self.place_array: FloatArray = np.zeros(2)
        self.model = GuideWireModel(
            arc=arc_m, flexibility=flexibility, curvature=curvature, catheter_bending=bending, catheter_torsion=torsion,
            catheter_rest=self.catheter_rest, joint_stiffness=model.joint_stiffness, torsion=twist.torsion,
            rest_rotation=twist.rest_rotation, rest_length=model.rest_length, mass=model.mass, drag=model.drag,
            EA=model.EA, load=np.zeros((properties.n_particles, 3)), moment=np.zeros((properties.n_particles - 2, 3)),
            density=density, own_mass=float(inside_kg),
            viscous=float(properties.viscous_drag_n_s_m2), own_drag=0.5 * float(drag[c]),
            poisson=wire.poisson_ratio, radius=0.5 * wire.outer_diameter_m, friction=wire.friction,
            clearance=0.5 * (scene.inner_diameter_m - wire.outer_diameter_m), tip=c,
        )  # fmt: skip
        self.set_place((wire.out_m, 0.0))
        edge_m = state.position_m[1] - state.position_m[0]
        state.position_m[1:] = (
            state.position_m[0] + np.outer(np.cumsum(model.rest_length), edge_m) / model.rest_length[0]
        )
        state.frame = initial_frame(state.position_m)

    def set_place(self, place: Place) -> None:
        """Recompute the rod's arrays with the wire at ``place``."""
        self.place_array[:] = place
        write_rod_properties(self.model.address, place)

    @property
    def place(self) -> Place:
        """Present place of the wire."""
        return float(self.place_array[0]), float(self.place_array[1])

    def grow(self, speed_m_s: float) -> None:
        """Set the speed in m/s at which the protruding part lengthens in this step, which causes no strain."""
        tip = self._rod.tip
        self._rod.growth[tip:] = speed_m_s / (len(self._rod.rest_length) - tip)

    def stored_j(self, state: RodState, place: Place) -> tuple[float, float]:
        """Return the energies of `rod.guide_wire.stored_energies`."""
        out: tuple[float, float] = stored_energies(self.model.address, state.position_m, frame_of(state), place)
        return out


def lay_at_rest(scene: CatheterScene, properties: RodProperties, supports: Supports, state: RodState) -> None:
    """Move a catheter to its rest shape with the wire in it: in its introducer, proximal end held, without contacts."""
    integrator = ImplicitIntegrator(properties, replace(supports, held=(0,)))
    GuideWire(scene, properties, integrator, state)
    nothing = np.zeros_like(state.position_m)
    for _ in range(_MOST_STEPS):
        start_m = state.position_m.copy()
        integrator.predict(state, nothing, _SLOW_S)
        state.halt()
        if float(np.max(np.abs(state.position_m - start_m))) < _RESTING_M:
            return


def frame_of(state: RodState) -> Frame:
    """Return the arrays of a rod's material frame."""
    frame = state.frame
    assert frame is not None
    return frame.tangent, frame.m1, frame.twist_rad


def _sections(wire: GuideWireScene, tube: RoundTube) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `GuideWireModel`'s ends, flexibilities and rest curvatures of sections, from the tip on, the body last."""
    moduli = np.array(
        [*(each.youngs_modulus_pa or wire.youngs_modulus_pa for each in wire.sections), wire.youngs_modulus_pa]
    )
    lengths_m = [*(section.length_m for section in wire.sections), _FAR_M]
    bent = np.array([*(section.rest_curvature_1_m[:2] for section in wire.sections), (0.0, 0.0)])
    return np.cumsum([0.0, *lengths_m]), 1.0 / (moduli * tube.second_moment_m4()), bent
