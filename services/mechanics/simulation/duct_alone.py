"""Simulation of a scene of only a duct, one tick at a time, without catheter, tools and contacts.

Only the effects of the wall (`Effect.of_wall`) act, which need nothing else.
"""

from __future__ import annotations

from itertools import pairwise
from math import inf
from time import perf_counter_ns
from types import SimpleNamespace
from typing import cast

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.duct_loads import DuctMotion, begin_duct_loads, motion_at
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.effects import act, build_effects, by_stage
from trocar.services.mechanics.reduction import ModalState, ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation.scene_world import build_duct_body
from trocar.services.mechanics.simulation.step_splitting import steps_of
from trocar.services.mechanics.world import World

STAGE_NAMES = ("loads", "predict", "correct")
#: Energy of all modes, in J, below which a duct is at rest: a piconewton over a picometre.
REST_J = 1e-24
_CAPACITY = 1  # contacts; there are none


class DuctAlone:
    """A duct that nothing can touch. At rest it sleeps if no effect acts in steps: a step then only checks this.

    Args:
        scene: SceneModel. With ``duct_alone``.
        duct: ReducedDuct. From `build_scene_duct`.

    Attributes:
        cost_ns: list of int. Time that each of `STAGE_NAMES` took in the last tick.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        if not scene.duct_alone:
            raise ValueError("the scene names more than a duct: it takes a Simulation")
        self.scene = scene
        effects = tuple(build_effects(scene).values())
        self._stages = by_stage(effects)
        self.duct = build_duct_body(scene, duct, self._stages["constant_load_n"], _CAPACITY)
        # Effects are typed for a complete world; those of the wall use only this part.
        self._world = cast(World, SimpleNamespace(scene=scene, duct=self.duct, effects=effects, clearance_m=inf))
        self._rest = (self.duct.motion_address, duct.basis.omega_rad_s**2)
        self._may_sleep = scene.sleeping and not (self._stages["add_loads"] or self._stages["after_solve"])
        self.cost_ns = [0] * len(STAGE_NAMES)
        for effect in self._stages["prepare"]:
            effect.prepare(self._world)

    @property
    def state(self) -> ModalState:
        """Modal coordinates of the duct."""
        return self.duct.state

    def is_asleep(self) -> bool:
        """Return whether the next step would not move the duct."""
        return self._may_sleep and bool(is_at_rest(*self._rest))

    def step(self, dt_s: float = 1e-3) -> None:
        """Advance by a tick of ``dt_s`` seconds; a tick longer than a millisecond is split into steps."""
        began_ns = perf_counter_ns()
        self.cost_ns[:] = 0, 0, 0
        if self.is_asleep():
            self.cost_ns[1] = perf_counter_ns() - began_ns
            return
        steps = steps_of(dt_s)
        for _ in range(steps):
            self._step(dt_s / steps)

    def _step(self, dt_s: float) -> None:
        marks = [perf_counter_ns()]
        self.duct.change_step(dt_s)  # before the effects, which use the displacement per force in a step
        begin_duct_loads(self.duct.motion_address)
        act(self._stages, "add_loads", self._world, dt_s)
        marks.append(perf_counter_ns())
        self.duct.predict(dt_s)
        marks.append(perf_counter_ns())
        act(self._stages, "settle", self._world, dt_s)
        act(self._stages, "after_solve", self._world, dt_s)
        marks.append(perf_counter_ns())
        for stage, (start, end) in enumerate(pairwise(marks)):
            self.cost_ns[stage] += end - start


@kernel
def is_at_rest(motion_address: Address[DuctMotion], omega_2: FloatArray) -> bool:
    """Return whether kinetic energy plus elastic energy relative to equilibrium is at most `REST_J`.

    ``omega_2`` (r,) is the square of the modes' angular frequencies. A NaN is not at rest.
    """
    duct, energy = motion_at(motion_address), 0.0
    for mode in range(duct.q.shape[0]):
        out_of_balance = duct.constant[mode] - omega_2[mode] * duct.q[mode]
        energy += 0.5 * (duct.qdot[mode] ** 2 + out_of_balance**2 / omega_2[mode])
    return bool(energy <= REST_J)
