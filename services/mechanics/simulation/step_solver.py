"""Solves for the contact forces of a step, again while overlaps remain."""

from __future__ import annotations

from collections.abc import Mapping

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import ContactPairs, append_copies
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.contact.working_set import tolerated_overlap_m
from trocar.services.mechanics.effects import Effect, act
from trocar.services.mechanics.simulation.step_splitting import LONGEST_STEP_S
from trocar.services.mechanics.world import World

#: Candidates are priced at most this often in a step; remaining violations become rows of the next step.
MAX_PRICINGS = 8
#: Places that another try from the same start begins with, at most: those of two prices and more. With all that many
#: tries find, a solve alone takes the work of a tick.
MOST_KNOWN = 64
# Work is told in block products (3 x 3) of a solve, which take 2.3 ns each where they are fastest. What else costs as
# much was measured in drawn cases (some 700 steps each, of 20 to 170 rows and up to 1,300 candidates), beside them.
#: Block products that a tick may take before it keeps what is sound by then. On a machine without other work a product
#: of a solve takes 1.2 to 1.5 ns, so that is 10 ms; beside other work up to 1.7 times as much, which is within 20 ms.
MOST_PRODUCTS = 8_000_000
#: All else of a part that has contacts, 0.35 ms: prediction, detection, effects, and what is saved.
PART_PRODUCTS = 150_000
#: Rows are assembled from the compliances of nodes and particles in 0.1 us for each pair.
ASSEMBLY_PRODUCTS = 50
#: A look takes 40 us, and 0.25 us for each candidate. Their nodes, three of each or all of the wall's, are placed in
#: 0.5 us, and 5 ns for each node with a load.
LOOK_PRODUCTS, CANDIDATE_PRODUCTS, NODE_PRODUCTS, LOADED_PRODUCTS = 16_000, 100, 200, 2


class Pricing:
    """Finds candidates without a row that overlap at the end of a step (pricing, as in column generation).

    Attributes:
        new_rows: int. Number of rows added since the start.
        n_found: int. Number of places since the start that were found to end too deep without a row.
        is_off: bool. Whether nothing is priced: the contact model or the catheter's integrator is another.
    """

    def __init__(self, world: World) -> None:
        self._world, self._search = world, world.search
        duct, catheter, tools = world.duct, world.catheter, world.tools
        self._ends = SavedArrays([*duct.corrected_arrays(), *catheter.corrected_arrays(), *tools.corrected_arrays()])
        self._touched = catheter.touched
        self._pairs = ContactPairs.zeros(capacity=world.scene.contact.capacity)
        self._known = ContactPairs.zeros(capacity=MOST_KNOWN)
        self.is_off = not world.system.strategy.keeps_delassus or catheter.plain_integrator is None
        self.new_rows = self.n_found = 0

    def save(self) -> None:
        """Save the bodies' state before forces are applied."""
        if not self.is_off:
            self._ends.save()
            self._touched = self._world.catheter.touched

    def finds_violations(self) -> bool:
        """Return whether a candidate without a row ends too deep; the places are known until they are forgotten.

        Not those of a solve that was cut short: it leads the bodies to places where the solution does not.
        """
        if self.is_off or self._search.price(self._world.system, self.tolerance_m, self._pairs) == 0:
            return False
        if self._world.system.is_cut:
            return True
        known = self._known
        if known.count + self._pairs.count > MOST_KNOWN:
            known.clear()
        self.n_found -= known.count
        append_copies(known.address, self._pairs.address)
        self.n_found += known.count
        return True

    @property
    def n_wanted(self) -> int:
        """Number of rows that the last price calls for."""
        return int(self._pairs.count)

    @property
    def n_known(self) -> int:
        """Number of places that are known to end too deep without a row, from the present start."""
        return int(self._known.count)

    def append_known(self) -> None:
        """Append rows at the places that are known: another try begins with what those before it have found."""
        if self._known.count:
            self._world.system.append_as_many(self._known)

    def forget_known(self) -> None:
        """Know no places, because what follows begins elsewhere."""
        if self._known.count:
            self._known.clear()

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
            append_copies(self._known.address, self._pairs.address)
            self.forget_known()


class StepSolver:
    """Solves for the forces of a step's rows and applies them to the bodies.

    Args:
        tool_force: (n_tools, n_coordinates). Receives the generalised force on each tool.

    Attributes:
        products: float. Block products that have been taken since a caller set it to zero: of solves, assembly, prices.
        pricing: Pricing. It checks the candidates at the end of the step.
        tool_force: (n_tools, n_coordinates). Generalised force on each tool from the last solve.
    """

    def __init__(self, world: World, tool_force: FloatArray) -> None:
        self._world, self._system, self.tool_force = world, world.system, tool_force
        self.pricing = Pricing(world)
        self._stages: Mapping[str, tuple[Effect, ...]] = {}
        self._iterations, self.products = 0, 0.0

    @property
    def is_spent(self) -> bool:
        """Whether this tick has taken all the products that it may take."""
        return self.products >= MOST_PRODUCTS

    def charge_looks(self, count: int) -> None:
        """Charge measuring all candidates so often, where the loads of the contacts have moved the wall."""
        self.products += count * self._products_of_look()

    def _products_of_look(self) -> float:
        n_loads, n_candidates = int(self._world.duct.load_arrays()[2][0]), self._world.search.n_candidates
        n_nodes = min(3 * n_candidates, self._world.duct.reduced.mesh.n_vertices)
        placed = n_nodes * (NODE_PRODUCTS + LOADED_PRODUCTS * n_loads)
        return LOOK_PRODUCTS + CANDIDATE_PRODUCTS * n_candidates + placed

    def _affords_another(self) -> bool:
        """Return whether new rows can be assembled, all swept twice and priced once more with what is left."""
        before, new = self._system.rows.n_contacts, self.pricing.n_wanted
        k = before + new
        products = ASSEMBLY_PRODUCTS * (k * k - before * before) + 2 * k * k + self._products_of_look()
        return self.products + products < MOST_PRODUCTS

    @property
    def prices(self) -> bool:
        """Whether candidates are priced at the end of a step."""
        return not self.pricing.is_off

    def use(self, stages: Mapping[str, tuple[Effect, ...]], iterations: int) -> None:
        """Solve with these effects, by stage, in at most ``iterations`` sweeps."""
        self._stages, self._iterations = stages, iterations

    def prepare(self, dt_s: float) -> None:
        """Complete the collected rows and assemble the compliance between them."""
        self.products += PART_PRODUCTS
        self._system.complete_rows()
        act(self._stages, "add_motion", self._world, dt_s)
        act(self._stages, "set_friction", self._world, dt_s)
        self._assemble()

    def solve(self, dt_s: float) -> bool:
        """Solve for the forces and apply them; return whether no candidate ends too deep, nor a row that is not solved.

        A price takes rows at their word: where a solve has been cut short, depths must be measured.
        """
        system, pricing = self._system, self.pricing
        if system.rows.n_contacts > 0:
            self._solve(dt_s)
        else:
            system.clear_forces()
        self._apply()
        for _ in range(MAX_PRICINGS):
            self.charge_looks(1)
            if not pricing.finds_violations() or system.is_cut:
                return not system.is_cut
            if not (self._affords_another() and system.rows.has_room):  # without room it is repeated in halves
                return False
            if pricing.return_with_new_rows():
                self._complete_new_rows(dt_s)
            self._solve(dt_s)
            self._apply()
        return not pricing.finds_violations()

    def _solve(self, dt_s: float) -> None:
        self.products += self._system.solve(self._iterations, dt_s, MOST_PRODUCTS - self.products)

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
        self._assemble()

    def _assemble(self) -> None:
        self.products += ASSEMBLY_PRODUCTS * self._system.assemble()
