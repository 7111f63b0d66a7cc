"""A scene that moves with contact as one pipeline: candidates, working set, solve, price, step.

It stands beside `Simulation`, whose detection and manifolds it does without, until it has taken their place. Not yet:
stones, which go on by the old detection and are not priced, and the inserted length, which is 0.
"""

from __future__ import annotations

from operator import add, sub
from time import perf_counter_ns

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.contact.candidate_search import CandidateSearch
from services.mechanics.contact.engagement import engage_tools
from services.mechanics.contact.pads import take_pads
from services.mechanics.reduction import ReducedDuct
from services.mechanics.scene import SceneModel
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation.pricing import Pricing
from services.mechanics.simulation.simulation import Simulation
from services.mechanics.simulation.step_solver import StepSolver
from services.mechanics.world import World

#: A step that ends with something too deep is taken in halves, so often: an eighth of a millisecond at least.
MOST_HALVINGS = 3
#: So often candidates are priced in a step, at most: what is left then is a row of the next step.
MOST_PRICES = 8


class PricedSolver(StepSolver):
    """Solves a step, prices its candidates, and solves on with those that end too deep.

    Attributes
    ----------
    pricing : Pricing
    """

    def __init__(self, world: World, search: CandidateSearch, simulation: Simulation) -> None:
        super().__init__(world, simulation.solver.tool_force)
        self.pricing = Pricing(world, search)

    def settle(self, dt_s: float) -> bool:
        """Find the forces and give them to the bodies; return whether nothing is left that ends too deep."""
        system, pricing = self._system, self.pricing
        if system.rows.n_contacts > 0:
            system.solve(self._iterations, dt_s)
        else:
            system.rest()
        self._plan_again(dt_s)
        pricing.note()
        self._give()
        for _ in range(MOST_PRICES):
            if not pricing.finds_violations():
                return True
            pricing.take_back()
            pricing.append_rows()
            self._solve_with_new_rows(dt_s)
            pricing.note()  # the catheter may have been planned again, and ends elsewhere without forces
            self._give()
        return not pricing.finds_violations()


class PricedSimulation(Simulation):
    """A `Simulation` whose contacts come from one list of candidates.

    Parameters
    ----------
    scene : SceneModel
    duct : ReducedDuct

    Attributes
    ----------
    candidates : CandidateSearch
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        super().__init__(scene, duct)
        self.candidates = CandidateSearch(self.scene, duct)
        self._bodies = self.duct, self.catheter, self.tools
        self._priced = PricedSolver(self.world, self.candidates, self)
        self.solver = self._priced
        self._use_rung(self.quality_level)

    @property
    def pricing(self) -> Pricing:
        """What it found since the start."""
        return self._priced.pricing

    def _step_in_parts(self, tools: ToolInputs, pairs: ContactPairs | None, dt_s: float) -> bool:
        parts = self._pace.parts(tools, dt_s)
        return all(self._take_part(tools, dt_s / parts, MOST_HALVINGS) for _ in range(parts))

    def _take_part(self, tools: ToolInputs, dt_s: float, halvings: int) -> bool:
        """Advance by a part of a step, or by its halves where it does not come to an end without overlap."""
        self.duct.change_step(dt_s)
        if self.watcher is not None:
            self.watcher.begin()
        self.pricing.begin()
        if not self._move(tools, dt_s) and halvings > 0:
            self.pricing.retreat()
            return all(self._take_part(tools, 0.5 * dt_s, halvings - 1) for _ in range(2))
        self._end_step(dt_s)
        if self.watcher is not None:
            self.watcher.end(dt_s)
        return self._healer.watch() and self.candidates.is_sound()

    def _move(self, tools: ToolInputs, dt_s: float) -> bool:
        """Move everything by a step that nothing crosses unseen; return whether nothing ends too deep."""
        marks = self._marks_ns
        marks[0] = perf_counter_ns()
        self._add_loads(dt_s)
        marks[1] = perf_counter_ns()
        self.duct.predict(dt_s)
        self.catheter.predict(dt_s)
        self._predict_tools(tools, dt_s)
        marks[2] = perf_counter_ns()
        self._collect(tools, None, dt_s)
        marks[3] = perf_counter_ns()
        if self.system.rows.n_contacts > 0:
            self._priced.prepare(dt_s)
        marks[4] = perf_counter_ns()
        is_settled = self._priced.settle(dt_s)
        marks[5] = perf_counter_ns()
        self.cost_ns[:5] = map(add, self.cost_ns, map(sub, marks[1:6], marks[:5]))
        return is_settled

    def _end_step(self, dt_s: float) -> None:
        """Let effects act on the end of a step, and write what tools feel."""
        marks = self._marks_ns
        marks[5] = perf_counter_ns()
        self._correct(dt_s)
        marks[6] = perf_counter_ns()
        self._report(dt_s)
        marks[7] = perf_counter_ns()
        self.cost_ns[5:] = map(add, self.cost_ns[5:], map(sub, marks[6:], marks[5:7]))

    def _collect(self, tools: ToolInputs, pairs: ContactPairs | None, dt_s: float) -> None:
        """Turn chosen candidates, and the holds, into contact rows."""
        system = self.system
        system.let_go_of_tools()
        system.clear()
        self.seal.append_row()
        self.squeeze.append_rows(self.tools)
        self.search.start(self.duct)
        self.candidates.begin(self._bodies)
        found, catheter_pairs = self._tool_pairs, self.world.pairs
        found.clear()
        catheter_pairs.clear()
        self.candidates.tool_pairs(self.catheter, self.tools, found)
        self.candidates.catheter_pairs(catheter_pairs)
        if self.tools.have_come:
            engage_tools(found.address, system.geometry.address)
        self.holds.follow(self._grasp(tools, found) if tools.holds is None else tools.holds)
        if self.holds.took_up and tools.holds is not None:
            take_pads(found.address, system.geometry.address)
        for effect in self._stages["add_pairs"]:
            effect.add_pairs(self.world, dt_s)
        system.append(found)
        system.append(catheter_pairs)
        for effect in self._stages["add_rows"]:
            effect.add_rows(self.world, dt_s)
        self.holds.append_rows()

    def _correct(self, dt_s: float) -> None:
        self.seal.slide()
        self.holds.slide()
        self.candidates.note_pressed(self.system.address)
        self.squeeze.follow(self.tools, dt_s)
        for effect in self._stages["settle"]:
            effect.settle(self.world, dt_s)
        for effect in self._stages["after_solve"]:
            effect.after_solve(self.world, dt_s)

    def _heal(self, dt_s: float) -> None:
        super()._heal(dt_s)
        self.candidates.forget()
