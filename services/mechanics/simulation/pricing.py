"""Prices a solved step: what ends too deep gets a row, and the solve goes on."""

from __future__ import annotations

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.compiled.memory import copy_arrays, copy_table
from services.mechanics.contact.working_set import TOUCHING_M
from services.mechanics.simulation.pace import LONGEST_STEP_S
from services.mechanics.world import World

#: A candidate without a row may end as deep as what touches, in a longer step by as much more as it is longer, and in a
#: thin wall by this part of it.
TOLERANCE_OF_WALL = 0.125


class Pricing:
    """Prices the steps of a world whose contacts act within the step.

    Attributes:
        violations: int. Prices since the start that found any.
        new_rows: int. Rows that came of them.
    """

    def __init__(self, world: World) -> None:
        self._world, self._search = world, world.search
        duct, catheter, tools = self._bodies = world.duct, world.catheter, world.tools
        live = [*duct.given_arrays(), *catheter.given_arrays(), *tools.given_arrays()]
        kept = [array.copy() for array in live]
        self._note, self._take_back = copy_table(kept, live), copy_table(live, kept)
        self._touched = catheter.touched
        pose = [tools.segments, tools.frame, tools.length_m]
        kept_pose = [array.copy() for array in pose]
        self._note_pose, self._put_pose = copy_table(kept_pose, pose), copy_table(pose, kept_pose)
        self._pairs = ContactPairs.allocate(world.scene.contact.capacity)
        self._is_off = not world.system.strategy.knows_stiffness or catheter.plain_integrator is None
        self.violations = self.new_rows = 0
        self._kept = kept, kept_pose

    def note(self) -> None:
        """Note the bodies before forces are given to them, if anything is near."""
        if not self._is_off and self._search.has_candidates:
            copy_arrays(self._note)
            self._touched = self._world.catheter.touched

    def finds_violations(self) -> bool:
        """Return whether something ends too deep that no row holds."""
        return not self._is_off and self._search.has_candidates and self._price()

    def _price(self) -> bool:
        copy_arrays(self._note_pose)
        self._world.tools.update_pose()
        longer = max(1.0, self._world.duct.dt_s / LONGEST_STEP_S)
        tolerance_m = min(longer * TOUCHING_M, TOLERANCE_OF_WALL * self._world.scene.duct.thickness_m)
        found = self._search.price(self._bodies, self._world.system.address, tolerance_m, self._pairs)
        copy_arrays(self._put_pose)
        self.violations += found > 0
        return found > 0

    def take_back(self) -> None:
        """Take the forces back from the bodies."""
        copy_arrays(self._take_back)
        self._world.catheter.touched = self._touched

    def append_rows(self) -> None:
        """Append rows of what ended too deep."""
        rows = self._world.system.rows
        before = rows.n_contacts
        self._world.system.append_new(self._pairs)
        self.new_rows += rows.n_contacts - before

    def compile_kernels(self) -> None:
        """Compile what a price asks for: the first violation may come late, as what is near may, while a loop runs."""
        if not self._is_off:
            copy_arrays(self._note)
            self._price()
            self.take_back()
            self.append_rows()
