"""Detection of unsound states at the end of a step, and recovery from them.

A state is sound if it is physically possible: all numbers are finite, the catheter is neither torn nor too fast, and
its axis does not pierce the wall. No solved motion takes a body through another, see `motion_share`: what is left are
states that a caller has set, and numbers that no solve can mend. Recovery restores the start of the step, at rest and
with unstretched couplings, because otherwise the restored state would return energy that has been dissipated. If that
start is not sound either, because a caller has set it, the last sound copy is restored.

The cause may act again at once. If the last recovery was at most `AGAIN` steps ago, tools have no contact until they
have been withdrawn.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import dot, row, squared_distance
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.mechanics.simulation.step_splitting import LONGEST_STEP_S, SHORTEST_STEP_S
from trocar.services.mechanics.simulation.step_start import StepStart
from trocar.services.mechanics.world import World

# A polymer yields at a few per cent; the strongest pull of both grips stretches a catheter by two. A rod released from
# a strain moves at that strain times the speed of sound.
MOST_STRETCH = 0.25
# A recovery has succeeded after this many sound steps: the greatest number of substeps in a tick.
AGAIN = round(LONGEST_STEP_S / SHORTEST_STEP_S)


class LiveState(Struct):
    """The arrays of a world that decide whether its state is sound, and their limits."""

    position: Annotated[FloatArray, "n", 3]
    velocity: Annotated[FloatArray, "n", 3]
    q: Annotated[FloatArray, "r"]
    qdot: Annotated[FloatArray, "r"]
    proxy: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    hand: Annotated[FloatArray, N_TOOLS, N_COORDINATES]
    longest_m: float  # segment of the catheter
    fastest_m_s: float

    @classmethod
    def of(cls, world: World) -> LiveState:
        """Return views of a world's arrays, which are only changed in place."""
        rod, duct, tools = world.catheter.state, world.duct.state, world.tools
        return cls(
            position=rod.position_m,
            velocity=rod.velocity_m_s,
            q=duct.q,
            qdot=duct.qdot,
            proxy=tools.proxy,
            hand=tools.hand,
            longest_m=world.catheter.properties.segment_length_m * (1.0 + MOST_STRETCH),
            fastest_m_s=MOST_STRETCH * world.catheter.properties.sound_m_s(),
        )


live_at = reader(LiveState)


class Healer:
    """Checks the state of a world after each step and restores an earlier one where it is unsound.

    Args:
        start: StepStart. The saved start of the last substep.

    Attributes:
        healed: int. Number of recoveries since the start.
    """

    def __init__(self, world: World, start: StepStart) -> None:
        self._world, self._start = world, start
        self._live = LiveState.of(world)
        live = [array for body in (world.duct, world.catheter, world.tools) for array in body.state_arrays()]
        live += [array for effect in world.effects for array in effect.state_arrays()]
        self._sound = SavedArrays(live)
        self._has_sound, self._sound_steps, self.healed = False, 0, 0

    def begin(self) -> None:
        """Refuse an invalid initial state.

        Raises ValueError: it holds a NaN or an infinity before the first step.
        """
        if not self._has_sound and not numbers_are_finite(self._live.address):
            raise ValueError("the state of catheter, duct or tools holds a NaN or an infinity before the first step")

    def watch(self) -> bool:
        """Return whether the state at the end of a step is sound.

        A scene whose caller set an unsound but finite state is left to recover by itself.
        """
        is_sound = state_is_sound(self._live.address) and self._world.search.is_sound()
        if is_sound and self._sound_steps % AGAIN == 0:
            self._sound.save()
            self._has_sound = True
        self._sound_steps += is_sound
        return is_sound or not self._has_sound

    def heal(self) -> None:
        """Restore the start of the step, or the last sound copy, at rest and with all holds released."""
        world = self._world
        self._start.restore()
        if not state_is_sound(self._live.address):
            self._sound.restore()
        if self.healed > 0 and self._sound_steps <= AGAIN:
            world.tools.present[:] = False  # a tool that reappears inside a body has no contact, see `engagement`
        self.healed, self._sound_steps = self.healed + 1, 1
        for body in (world.duct, world.catheter, world.tools):
            body.halt()
        for part in (world.system, world.seal, world.squeeze, world.search):
            part.forget()
        world.holds.release_all()


@kernel
def state_is_sound(live_address: Address[LiveState]) -> bool:
    """Return whether all numbers are finite, and segment lengths and speeds of the catheter within their limits."""
    live = live_at(live_address)
    for i in range(live.position.shape[0]):
        velocity = row(live.velocity, i)
        length_2 = squared_distance(row(live.position, i), row(live.position, max(i - 1, 0)))
        # Written so that a NaN is unsound.
        if not (length_2 <= live.longest_m**2 and dot(velocity, velocity) <= live.fastest_m_s**2):
            return False
    return bool(numbers_are_finite(live_address))


@kernel
def numbers_are_finite(live_address: Address[LiveState]) -> bool:
    """Return whether all numbers of a state are finite."""
    live, total = live_at(live_address), 0.0
    for i in range(live.position.shape[0]):
        for axis in range(3):
            total += 0.0 * (live.position[i, axis] + live.velocity[i, axis])
    for mode in range(live.q.shape[0]):
        total += 0.0 * (live.q[mode] + live.qdot[mode])
    for tool in range(live.proxy.shape[0]):
        for axis in range(live.proxy.shape[1]):
            total += 0.0 * (live.proxy[tool, axis] + live.hand[tool, axis])
    return bool(total == 0.0)
