"""States that are physically impossible: no solved motion ends in one, and one that a caller has set is put back.

A state is possible if all numbers are finite and the catheter is neither torn nor too fast. A solved motion that ends
otherwise is not accepted, like one that ends too deep (`motion_share`). What a caller has set between two ticks is
replaced by the state that the last step began with, at rest and with unstretched couplings, because otherwise it would
return energy that has been dissipated.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import dot, row, squared_distance
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.mechanics.simulation.step_start import StepStart
from trocar.services.mechanics.world import World

# A polymer yields at a few per cent; the strongest pull of both grips stretches a catheter by two. A rod released from
# a strain moves at that strain times the speed of sound.
MOST_STRETCH = 0.25


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
    """Judges whether a state is possible, and puts back one that is not.

    A scene that begins with a finite but impossible state is left to recover by itself.

    Args:
        start: StepStart. The saved start of the last substep.

    Attributes:
        healed: int. Number of states that were put back since the start.
    """

    def __init__(self, world: World, start: StepStart) -> None:
        self._world, self._start = world, start
        self._live = LiveState.of(world)
        self._was_sound, self.healed = False, 0

    def must_heal(self) -> bool:
        """Return whether a tick begins with an impossible state, although the last one had another.

        Raises ValueError: a state holds a NaN or an infinity before any has been sound.
        """
        is_sound = bool(state_is_sound(self._live.address))
        if not (is_sound or self._was_sound or numbers_are_finite(self._live.address)):
            raise ValueError("the state of catheter, duct or tools holds a NaN or an infinity before the first step")
        must_heal = self._was_sound and not is_sound
        self._was_sound |= is_sound
        return must_heal

    def accepts(self) -> bool:
        """Return whether the end of a solved motion is possible; any is, where its start was not."""
        return not self._was_sound or bool(state_is_sound(self._live.address))

    def heal(self) -> None:
        """Restore the start of the last step, at rest and with all holds released."""
        world = self._world
        self._start.restore()
        self.healed += 1
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
