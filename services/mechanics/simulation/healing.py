"""States that no hand can have brought about are found at the end of a step, and the last sound one is taken up again.

What is sound is judged by what bodies can do at all, not by what is likely: numbers that are finite, a catheter that is
neither torn nor shot, and whose axis goes through the wall nowhere. A state that is taken up again is at rest, and the
couplings restart unstretched; otherwise the restored copy would hand back energy already spent. For the same reason it
is the newest of several copies that stores no more than was there when the bad step began.

What made a state unsound may do so again at once. So a copy is taken up once: heals that follow each other go further
back, to the first state of all at last, and from the second on tools touch nothing until they have been withdrawn.
"""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import AnyArray, FloatArray
from services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.scene.tools import N_TOOLS
from services.mechanics.simulation.body_energy import body_energies_j
from services.mechanics.simulation.copies import Copies
from services.mechanics.world import World

# A polymer yields at a few per cent; the strongest pull of both grips stretches a catheter by two. What stores that
# strain, let go, moves by it times the speed of sound.
MOST_STRETCH = 0.25
# Copies are made so many steps apart; the newest may already be on its way to what is not sound.
APART = 16
# A hundredth of what a catheter's length holds at a tenth of a metre per second: no energy.
NO_ENERGY_J = 1e-8


class LiveState(Struct):
    """The arrays of a world that say whether its state is sound, and what they must not pass."""

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
        """View the arrays of a world, which are only changed in place."""
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
    """Watches a world, and heals it.

    Attributes:
        healed: int. How often, since the start.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._copies: Copies | None = None
        self._steps = self.healed = 0
        self._live = LiveState.of(world)

    def begin(self) -> None:
        """Refuse to begin with what is no state.

        Raises ValueError: a caller has put a NaN or an infinity into it before the first step.
        """
        if self._copies is None and not numbers_are_finite(self._live.address):
            raise ValueError("the state of catheter, duct or tools holds a NaN or an infinity before the first step")

    def watch(self) -> bool:
        """Return whether the state at the end of a step is sound, and keep a copy now and then.

        A scene that a caller has begun in a state that is not sound is left to come out of it, while its numbers are.
        """
        is_sound = state_is_sound(self._live.address) and self._world.search.is_sound()
        if is_sound:
            if self._steps % APART == 0:
                self._keep()
            self._steps += 1
        return is_sound or self._copies is None

    def heal(self) -> None:
        """Go back to the last sound state, at rest, or further; whoever holds something lets go."""
        self.healed += 1
        world = self._world
        if self._copies is None:
            self._halt()
        else:
            if self._copies.are_all_trusted:  # whoever comes back inside something touches nothing, see `engagement`
                world.tools.present[:] = False
            self._take_up(self._copies)
        self._steps = 1
        world.holds.lose()
        world.system.forget()
        world.seal.forget()
        world.squeeze.forget()
        world.search.forget()

    def _take_up(self, copies: Copies) -> None:
        """Put back the newest copy that stores, at rest, no more than was there; or else the one that stores least.

        "There" is where the step began that was not sound: what it has made of that is nobody's.
        """
        world, places, stored_j = self._world, copies.places(), {}
        world.duct.go_back()
        world.catheter.go_back()
        there_j = _stored_j(world)
        for place in places:
            copies.put_back(place)
            self._halt()
            stored_j[place] = _stored_j(world)
            if stored_j[place] <= there_j + NO_ENERGY_J:
                break
        else:
            place = min(places, key=stored_j.__getitem__)
            copies.put_back(place)
            self._halt()
        copies.go_on_before(place)

    def _halt(self) -> None:
        for body in (self._world.duct, self._world.catheter, self._world.tools):
            body.halt()

    def _keep(self) -> None:
        if self._copies is None:
            self._copies = Copies(self._arrays())
        else:
            self._copies.keep()

    def _arrays(self) -> list[AnyArray]:
        world = self._world
        arrays = [*world.duct.state_arrays(), *world.catheter.state_arrays(), *world.tools.state_arrays()]
        for effect in world.effects:
            arrays += effect.state_arrays()
        return arrays


def _stored_j(world: World) -> float:
    effects_j = sum(effect.potential_energy_j(world) for effect in world.effects)
    return effects_j + sum(body_energies_j(world).values())


@kernel
def state_is_sound(live_address: Address[LiveState]) -> bool:
    """Return whether the numbers are finite, and the catheter neither torn nor shot."""
    return bool(_are_sound(live_at(live_address)))


@kernel
def _are_sound(live: LiveState) -> bool:
    """Return whether all numbers are finite and the catheter is neither longer nor faster than it may be."""
    position, velocity = live.position, live.velocity
    for i in range(position.shape[0]):
        length_2, speed_2 = 0.0, 0.0
        for axis in range(3):
            speed_2 += velocity[i, axis] ** 2
            if i > 0:
                length_2 += (position[i, axis] - position[i - 1, axis]) ** 2
        # Written so that what is no number is not sound either.
        if not (length_2 <= live.longest_m**2 and speed_2 <= live.fastest_m_s**2):
            return False
    return bool(_are_finite(live))


@kernel
def _are_finite(live: LiveState) -> bool:
    total = 0.0
    for i in range(live.position.shape[0]):
        for axis in range(3):
            total += 0.0 * (live.position[i, axis] + live.velocity[i, axis])
    for mode in range(live.q.shape[0]):
        total += 0.0 * (live.q[mode] + live.qdot[mode])
    for tool in range(live.proxy.shape[0]):
        for axis in range(live.proxy.shape[1]):
            total += 0.0 * (live.proxy[tool, axis] + live.hand[tool, axis])
    return bool(total == 0.0)


@kernel
def numbers_are_finite(live_address: Address[LiveState]) -> bool:
    """Return whether a state consists of numbers at all."""
    return bool(_are_finite(live_at(live_address)))
