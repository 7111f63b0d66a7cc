"""Interface of a simulation for its effects: bodies, contacts and collision detection, but nothing that steps them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.forceps import ToolBody
from trocar.services.mechanics.collision.pairs import ContactPairs
from trocar.services.mechanics.contact.candidate_search import CandidateSearch
from trocar.services.mechanics.contact.holds import HoldRegistry
from trocar.services.mechanics.contact.seal import IntroducerSeal
from trocar.services.mechanics.contact.squeeze import JawSqueeze
from trocar.services.mechanics.contact.system import ContactSystem
from trocar.services.mechanics.scene import SceneModel


class RestartablePart(Protocol):
    """A part of a world whose state at the start of a step is more than arrays."""

    def save_start(self) -> None:
        """Save the state at the start of a step."""

    def restore_start(self) -> None:
        """Restore the saved state."""


class WorldEffect(Protocol):
    """An effect, as the steps of a world know it: its state, its energy, and how far particles may move for it."""

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays of the state, which are only ever changed in place."""

    def step_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays that are saved whole where a step begins."""

    @property
    def restartable(self) -> RestartablePart | None:
        """State that is not in these, which is saved there as well."""

    def potential_energy_j(self, world: World) -> float:
        """Return the energy stored now."""

    def most_motion_m(self, particles_m: FloatArray) -> float:
        """Return how far particles at (n, 3) may move in a step without a contact that the effect would miss."""


@dataclass(frozen=True, slots=True)
class World:
    """The parts of one simulation, which owns them and steps them.

    Attributes:
        system: ContactSystem. Rows, compliance and forces of this step's contacts.
        holds: HoldRegistry. What the jaws hold.
        seal: IntroducerSeal. What the introducer holds.
        squeeze: JawSqueeze. What the jaws squeeze.
        search: CandidateSearch. Collision detection.
        pairs: ContactPairs. This step's candidate pairs.
        acceleration_m_s2: (3,) float64. Of the body forces on everything that has mass, in scene axes: zero unless an
            effect has added to it.
        effects: tuple of effects. Those of the scene.
    """

    scene: SceneModel
    duct: DuctBody
    catheter: CatheterBody
    tools: ToolBody
    system: ContactSystem
    holds: HoldRegistry
    seal: IntroducerSeal
    squeeze: JawSqueeze
    search: CandidateSearch
    pairs: ContactPairs
    acceleration_m_s2: FloatArray
    effects: tuple[WorldEffect, ...] = ()

    def add_spheres(self, radius_m: FloatArray) -> slice:
        """Add spheres of these radii, which touch wall and catheter; return where they are in the system's geometry."""
        spheres = self.system.geometry.spheres
        here = spheres.add(radius_m)
        self.search.set_spheres(spheres)
        return here

    @property
    def clearance_m(self) -> float:
        """How far the wall may move after the solve, before it touches a body; see `CandidateSearch.clearance_m`."""
        return self.search.clearance_m
