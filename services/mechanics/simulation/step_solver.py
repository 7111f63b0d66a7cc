"""Solves for the contact forces of a step, again while overlaps remain."""

from __future__ import annotations

from collections.abc import Mapping

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import ContactPairs
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.contact.working_set import tolerated_overlap_m
from trocar.services.mechanics.effects import Effect, act
from trocar.services.mechanics.simulation.step_splitting import LONGEST_STEP_S
from trocar.services.mechanics.world import World

#: Candidates are priced at most this often in a step; remaining violations become rows of the next step.
MAX_PRICINGS = 8
#: Block products (3 x 3) that a tick may take before it keeps what is sound by then: some 20 ms.
MOST_PRODUCTS = 4_000_000
#: Products that cost as much as pricing all candidates once.
PRICING_PRODUCTS = 60_000
#: Sweeps that cost as much as assembling the rows from the compliances of nodes and particles, with 80 rows.
ASSEMBLY_SWEEPS = 8


class Pricing:
    """Finds candidates without a row that overlap at the end of a step (pricing, as in column generation).

    Attributes:
        new_rows: int. Number of rows added since the start.
        is_off: bool. Whether nothing is priced: the contact model or the catheter's integrator is another.
    """

    def __init__(self, world: World) -> None:
        self._world, self._search = world, world.search
        duct, catheter, tools = world.duct, world.catheter, world.tools
        self._ends = SavedArrays([*duct.corrected_arrays(), *catheter.corrected_arrays(), *tools.corrected_arrays()])
        self._touched = catheter.touched
        self._pairs = ContactPairs.zeros(capacity=world.scene.contact.capacity)
        self.is_off = not world.system.strategy.keeps_delassus or catheter.plain_integrator is None
        self.new_rows = 0

    def save(self) -> None:
        """Save the bodies' state before forces are applied."""
        if not self.is_off:
            self._ends.save()
            self._touched = self._world.catheter.touched

    def finds_violations(self) -> bool:
        """Return whether a candidate without a row ends too deep."""
        if self.is_off:
            return False
        return self._search.price(self._world.system, self.tolerance_m, self._pairs) > 0

    @property
    def tolerance_m(self) -> float:
        """Overlap (m) in which a candidate may end this step without a row."""
        longer = max(1.0, self._world.duct.dt_s / LONGEST_STEP_S)
        return tolerated_overlap_m(self._world.scene.duct.thickness_m, longer)

    def return_with_new_rows(self) -> bool:
        """Restore the bodies' state from before forces were applied, append rows for violations that have none.

        Return whether there were any.
        """
        self._ends.restore()
        self._world.catheter.touched = self._touched
        rows = self._world.system.rows
        before = rows.n_contacts
        self._world.system.append_new_pairs(self._pairs)
        self.new_rows += rows.n_contacts - before
        return rows.n_contacts > before

    def compile_kernels(self) -> None:
        """Compile the kernels of a pricing now: the first candidate may appear only after the loop has started."""
        if not self.is_off:
            self._ends.save()
            self.finds_violations()
            self.return_with_new_rows()


class StepSolver:
    """Solves for the forces of a step's rows and applies them to the bodies.

    Args:
        tool_force: (n_tools, n_coordinates). Receives the generalised force on each tool.

    Attributes:
        products: int. Block products that solves have taken since a caller set it to zero, assembly included.
        pricing: Pricing. It checks the candidates at the end of the step.
        tool_force: (n_tools, n_coordinates). Generalised force on each tool from the last solve.
    """

    def __init__(self, world: World, tool_force: FloatArray) -> None:
        self._world, self._system, self.tool_force = world, world.system, tool_force
        self.pricing = Pricing(world)
        self._stages: Mapping[str, tuple[Effect, ...]] = {}
        self._iterations = self.products = 0

    @property
    def is_spent(self) -> bool:
        """Whether the solves of this tick have taken all the products that they may take."""
        return self.products >= MOST_PRODUCTS

    @property
    def prices(self) -> bool:
        """Whether candidates are priced at the end of a step."""
        return not self.pricing.is_off

    def use(self, stages: Mapping[str, tuple[Effect, ...]], iterations: int) -> None:
        """Solve with these effects, by stage, in at most ``iterations`` sweeps."""
        self._stages, self._iterations = stages, iterations

    def prepare(self, dt_s: float) -> None:
        """Complete the collected rows and assemble the compliance between them."""
        self._system.complete_rows()
        act(self._stages, "add_motion", self._world, dt_s)
        act(self._stages, "set_friction", self._world, dt_s)
        self._system.strategy.assemble()

    def solve(self, dt_s: float) -> bool:
        """Solve for the forces and apply them; return whether no candidate ends too deep."""
        system, pricing = self._system, self.pricing
        if system.rows.n_contacts > 0:
            self._solve(dt_s)
        else:
            system.clear_forces()
        self._apply()
        for _ in range(MAX_PRICINGS):
            self.products += PRICING_PRODUCTS
            if not pricing.finds_violations():
                return True
            if self.is_spent or not system.rows.has_room:  # without room the step is repeated in halves
                return False
            if pricing.return_with_new_rows():
                self._complete_new_rows(dt_s)
            self._solve(dt_s)
            self._apply()
        return not pricing.finds_violations()

    def _solve(self, dt_s: float) -> None:
        self._system.solve(self._iterations, dt_s)
        self.products += self._system.rows.n_contacts**2 * (self._system.sweeps + ASSEMBLY_SWEEPS)

    def _apply(self) -> None:
        """Save the bodies' state, and apply the forces to them."""
        self.pricing.save()
        self._world.squeeze.write_reactions()
        self._system.apply(self.tool_force)

    def _complete_new_rows(self, dt_s: float) -> None:
        act(self._stages, "add_motion", self._world, dt_s)
        old_friction = self._system.old_friction().copy()
        act(self._stages, "set_friction", self._world, dt_s)
        self._system.old_friction()[:] = old_friction  # which changes only in the rows appended last
        self._system.strategy.assemble()
