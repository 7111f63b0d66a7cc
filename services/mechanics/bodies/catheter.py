"""The catheter in a step: its integrator, loads from effects, and compliance at the touched particles."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, cast

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray, IntArray
from trocar.services.mechanics.bodies.guide_wire import GuideWire, lay_at_rest
from trocar.services.mechanics.bodies.sections import axial_softness, end_softness, segment_radii
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.rod import (
    Introducer,
    RodProperties,
    RodState,
    RoundTube,
    Supports,
    build_integrator,
    straight_rod,
)
from trocar.services.mechanics.rod.banded import RHS_BLOCK, empty_columns
from trocar.services.mechanics.rod.free_step import FreeStep, begin_step, continue_sleep, is_at_rest
from trocar.services.mechanics.rod.implicit import ImplicitIntegrator
from trocar.services.mechanics.scene import CatheterScene

BEARING_DIAMETERS = 5.0
"""Length over which the introducer's wall bears on the catheter, in outer diameters, for friction."""


class CatheterTouch(Struct):
    """Compliance between the touched ones of n particles, and scratch."""

    slot: Annotated[IntArray, "n"]
    particles: Annotated[IntArray, "n"]
    compliance: Annotated[FloatArray, "9 n n"]
    columns: Annotated[FloatArray, "padded", RHS_BLOCK]


touch_at = reader(CatheterTouch)


class CatheterBody:
    """Particles of the catheter, from the proximal end (0) to the tip.

    Attributes:
        wire: GuideWire, or None. The guide wire in it and beyond its tip.
        start_m, motion_m: (n, 3) float64. Positions at the start of the step, and the motion over it without contact
            forces.
        constant_force_n: (n, 3) float64. Constant loads of effects on the particles.
        external_force_n: (n, 3) float64. Loads of effects on the particles in this step, the constant ones included.
        contact_force_n: (n, 3) float64. Contact forces of the last step.
        step_address: Address[FreeStep], touch_address: Address[CatheterTouch]. Its loads, and scratch for the
            compliance of touched particles, for kernels.
        plain_integrator: ImplicitIntegrator or None. The implicit integrator, if contacts act in the same step.
        slept: bool. Whether this step was skipped because it is at rest.
        n_own_rows: int. Contact rows of this step with no other body, those of the introducer's friction. They do not
            wake it.
    """

    def __init__(
        self,
        scene: CatheterScene,
        properties: RodProperties,
        *,
        may_sleep: bool = False,
        acts_in_next_step: bool = False,
    ) -> None:
        self.properties = properties
        self.state = initial_state(scene, self.properties)
        self.integrator = build_integrator(
            scene.integrator, self.properties, rod_supports(scene), scene.spectral_radius
        )
        n = self.properties.n_particles
        self.radius_m, radii_m = 0.5 * scene.outer_diameter_m, segment_radii(scene)
        self.radii_m = np.append(radii_m, radii_m[-1])
        self.mass_kg = self.properties.particle_mass_kg()
        self.slept, self._last_dt_s = False, 0.0
        self.n_own_rows = 0
        self._was_touched = self._was_woken = False
        self._may_sleep = may_sleep
        self._linearises = scene.integrator == "implicit"
        self._acts_in_next_step = acts_in_next_step
        is_plain = type(self.integrator) is ImplicitIntegrator and not acts_in_next_step
        self.plain_integrator = cast(ImplicitIntegrator, self.integrator) if is_plain else None
        has_wire = scene.guide_wire is not None
        self.wire = GuideWire(scene, self.properties, self.integrator, self.state) if has_wire else None
        if has_wire:
            lay_at_rest(scene, self.properties, rod_supports(scene), self.state)
        step = FreeStep.zeros(n=n, start=self.state.position_m.copy(), last_external=np.full((n, 3), np.nan))
        self.start_m, self.motion_m = step.start, step.motion
        self.constant_force_n, self.external_force_n, self.contact_force_n = step.constant, step.external, step.contact
        self._step, self.step_address = step, step.address
        self.slot = np.full(n, -1, np.int32)
        touch = CatheterTouch.zeros(n=n, slot=self.slot, compliance=np.zeros(9 * n * n), columns=empty_columns(3 * n))
        self._particles, self._compliance = touch.particles, touch.compliance
        self._touch, self.touch_address = touch, touch.address

    def predict(self, dt_s: float) -> None:
        """Step the particles without contact forces.

        The implicit integrator linearises at the expected end of the step, which includes last tick's contact forces:
        without them a catheter pressed against a wall would first spring off it. They are subtracted afterwards.
        """
        state, step, integrator = self.state, self._step, self.integrator
        as_last = dt_s == self._last_dt_s  # the matrix is that of the last step
        if (
            self.slept
            and as_last
            and self._may_sleep_now
            and continue_sleep(step.address, state.position_m, state.velocity_m_s)
        ):
            return  # this test costs a third of the integrator's own
        may_sleep, self._last_dt_s = as_last and self._may_sleep_now, dt_s
        is_touched = self._was_touched and self._linearises
        plain = self.plain_integrator
        if plain is not None:
            self.slept = plain.step_freely(state, step.address, dt_s, (is_touched, may_sleep))
            return
        self.slept = begin_step(step.address, state.position_m, state.velocity_m_s, may_sleep)
        if self.slept:
            return
        integrator.predict(state, step.load if self._acts_in_next_step or is_touched else step.external, dt_s)
        if is_touched and not self._acts_in_next_step:
            integrator.correct(state, step.negated_contact)
        np.subtract(state.position_m, self.start_m, out=self.motion_m)

    def is_asleep(self) -> bool:
        """Whether the step can be skipped: nothing touches the catheter, its loads are unchanged, and it is at rest.

        State and factorised matrix are kept, ready for a contact in this step.
        """
        return self._may_sleep_now and bool(is_at_rest(self._step.address, self.state.velocity_m_s))

    @property
    def _may_sleep_now(self) -> bool:
        return self._may_sleep and not self._was_woken

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        state, frame = self.state, self.state.frame
        rolled = () if frame is None else (frame.tangent, frame.m1, frame.twist_rad)
        slid = () if self.wire is None else (self.wire.place_array,)
        return state.position_m, state.velocity_m_s, self.contact_force_n, *rolled, *slid

    def corrected_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that `correct` changes."""
        return self.state.position_m, self.state.velocity_m_s, self.contact_force_n

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes, from `predict` on."""
        words, *_ = self._step.own_memory()
        return *self.state_arrays(), words, self._step.last_external

    @property
    def touched(self) -> tuple[bool, bool, float]:
        """(Had contacts, had contacts that wake it, energy debt in J) of the last step; `correct` changes them."""
        return self._was_touched, self._was_woken, self._step.owed_j

    @touched.setter
    def touched(self, state: tuple[bool, bool, float]) -> None:
        self._was_touched, self._was_woken, self._step.owed_j = state

    def save_start(self) -> None:
        """Save the state at the start of a step beside `step_arrays`."""
        slow = self.state.slow_velocity_m_s
        self._saved_flags = self._was_touched, self._was_woken, self.slept, self.n_own_rows
        self._saved_slow = None if slow is None else slow.copy()

    def restore_start(self) -> None:
        """Restore it."""
        self._was_touched, self._was_woken, self.slept, self.n_own_rows = self._saved_flags
        self.state.slow_velocity_m_s = self._saved_slow

    def take_back(self, share: float) -> None:
        """Let the velocities that lag change by a share of what they have changed by since `save_start`."""
        slow, saved = self.state.slow_velocity_m_s, self._saved_slow
        if slow is not None and saved is not None:
            slow[:] = saved + share * (slow - saved)

    def halt(self) -> None:
        """Stop all motion at the present position."""
        self.state.halt()
        self.contact_force_n[:] = 0.0
        self._step.owed_j = 0.0
        self._step.last_external[:] = np.nan
        if self.wire is not None:
            self.wire.set_place(self.wire.place)

    def compliance(self, nodes: IntArray, weights: FloatArray) -> FloatArray:
        """Return a view (3 p, 3 p) of the compliance between touched particles in m/N; `slot` has their indices.

        ``nodes`` and ``weights`` (k, 4) are the particles that each contact acts on; those without weight are not
        touched.
        """
        count = list_particles(nodes, weights, self.slot, self._particles)
        size = 3 * count
        out: FloatArray = self._compliance[: size * size].reshape(size, size)
        if count:
            self.integrator.compliance(self._particles[:count], out)
        return out

    def correct(self, nodes: IntArray, weights: FloatArray, forces: FloatArray) -> None:
        """Apply the contact forces (k, 3) on the first bodies to the particles that they act on, see `compliance`.

        With ``acts_in_next_step`` they act over all of the next step, as in the paper's architecture (section VI):
        penalty forces are explicit anyway, and as an impulse they would excite the segments' stretch. While it sleeps
        untouched, the introducer's force at falling asleep is kept, and acts again when it wakes.
        """
        if self.slept and len(forces) == 0:
            return
        spread_rod_forces(nodes, weights, forces, self.contact_force_n)
        self.note_contacts(len(forces))
        if self._was_touched and not self._acts_in_next_step:
            self.integrator.correct(self.state, self.contact_force_n)

    def note_contacts(self, k: int) -> None:
        """Store that this step had k contact rows."""
        self._was_touched, self._was_woken = k > 0, k > self.n_own_rows


def round_tube(scene: CatheterScene) -> RoundTube:
    """Return section and material of a scene's catheter."""
    return RoundTube(
        outer_diameter_m=scene.outer_diameter_m,
        inner_diameter_m=scene.inner_diameter_m,
        youngs_modulus_pa=scene.youngs_modulus_pa,
        density_kg_m3=scene.density_kg_m3,
        poisson_ratio=scene.poisson_ratio,
    )


def rod_properties(scene: CatheterScene) -> RodProperties:
    """Stiffness and mass of a scene's catheter, without torsion."""
    rod = round_tube(scene).rod(
        scene.n_segments,
        scene.length_m,
        internal_damping_s=scene.internal_damping_s,
        viscous_drag_n_s_m2=scene.viscous_drag_n_s_m2,
    )
    if not scene.sections:
        return rod
    return replace(
        rod,
        axial_stiffness_n=axial_softness(scene) * rod.axial_stiffness_n,
        bending_stiffness_n_m2=end_softness(scene) * rod.bending_stiffness_n_m2,
    )


def initial_state(scene: CatheterScene, properties: RodProperties) -> RodState:
    """Return the state at rest: straight, with the tip at the scene's position."""
    direction = np.asarray(scene.direction) / np.linalg.norm(scene.direction)
    start = np.asarray(scene.tip_position_m) - scene.length_m * direction
    return straight_rod(properties, start, direction)


def rod_supports(scene: CatheterScene) -> Supports:
    """Return the supports of the proximal end."""
    if scene.anchor == "clamped":
        return Supports(held=(0,), start_direction=scene.direction)
    if scene.anchor == "introducer":
        return Supports(introducer=build_introducer(scene))
    return Supports()


def build_introducer(scene: CatheterScene) -> Introducer:
    """Return the introducer that the catheter starts in. Raises ValueError if the catheter starts outside it."""
    direction = np.asarray(scene.direction) / np.linalg.norm(scene.direction)
    exit_m = np.asarray(scene.tip_position_m) - scene.introducer_to_tip_m * direction
    entry_m = exit_m - scene.introducer_length_m * direction
    introducer = Introducer(
        entry_m,
        exit_m,
        friction=scene.introducer_friction,
        bearing_length_m=BEARING_DIAMETERS * scene.outer_diameter_m,
        seal_friction_n=scene.introducer_seal_friction_n,
    )
    inside_m = min(2.0 * scene.length_m / scene.n_segments, 0.5 * scene.introducer_length_m)
    longest_m = scene.length_m - inside_m
    if not introducer.least_tip_m <= scene.introducer_to_tip_m <= longest_m:
        raise ValueError(
            f"catheter.introducer_to_tip_m: {scene.introducer_to_tip_m:g} m leaves the catheter outside its "
            f"introducer; within {introducer.least_tip_m:g} and {longest_m:g} m it starts in it"
        )
    return introducer


@kernel
def list_particles(nodes: IntArray, weights: FloatArray, slot: IntArray, particles: IntArray) -> int:
    """Fill ``particles`` with the touched ones, ascending, and ``slot`` (n,) with their index in it, or -1."""
    slot[:] = -1
    for row in range(nodes.shape[0]):
        for point in range(nodes.shape[1]):
            if weights[row, point] != 0.0:
                slot[nodes[row, point]] = 0
    count = 0
    for particle in range(slot.shape[0]):
        if slot[particle] == 0:
            slot[particle] = count
            particles[count] = particle
            count += 1
    return count


@kernel
def spread_rod_forces(nodes: IntArray, weights: FloatArray, forces: FloatArray, out: FloatArray) -> None:
    """Write the contact forces on the particles (n, 3)."""
    out[:] = 0.0
    for row in range(nodes.shape[0]):
        for point in range(nodes.shape[1]):
            weight = weights[row, point]
            if weight != 0.0:
                for axis in range(3):
                    out[nodes[row, point], axis] += weight * forces[row, axis]
