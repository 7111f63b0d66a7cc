"""The forces of contact in a step: solved for, and once more where they bend the rod or lead where no row was."""

from __future__ import annotations

from collections.abc import Mapping

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.effects import Effect
from services.mechanics.simulation.second_look import SecondLook
from services.mechanics.world import World

# So often the catheter's step is planned again, at most, with contact forces that another plan has led to.
MOST_PLANS = 4


class StepSolver:
    """Finds the forces of a step's rows and gives them to the bodies.

    Parameters
    ----------
    world : World
    tool_force : (n_tools, n_coordinates)
        What acts on each tool is written here.

    Attributes
    ----------
    second_look : SecondLook
        Of steps that lead far.
    tool_force : (n_tools, n_coordinates)
        What acts on each tool, as solved last.
    """

    def __init__(self, world: World, tool_force: FloatArray) -> None:
        self._world, self._system, self.tool_force = world, world.system, tool_force
        self.second_look = SecondLook(world)
        self._stages: Mapping[str, tuple[Effect, ...]] = {}
        self._iterations = 0

    def use(self, stages: Mapping[str, tuple[Effect, ...]], iterations: int) -> None:
        """Solve with these effects, by stage, and so many sweeps at most."""
        self._stages, self._iterations = stages, iterations

    def prepare(self, dt_s: float) -> None:
        """Complete the rows that were collected, and assemble what they do to each other."""
        self._system.complete_rows()
        self._add_motion(dt_s)
        self._set_friction(dt_s)
        self._assemble(dt_s)

    def compile_kernels(self, pairs: ContactPairs | None = None) -> None:
        """Compile what a step rarely asks for: plans made again, and second looks, also with such pairs.

        The first of them may come late, while a loop runs. In a world that has taken steps with contacts.
        """
        catheter = self._world.catheter
        if catheter.plain_integrator is not None:
            catheter.keep_plan()
            self._try_plan(0.0, self._world.duct.dt_s)
        self.second_look.compile_kernels(pairs)

    def solve(self, dt_s: float, *, knows_tools: bool) -> None:
        """Find the forces and give them to the bodies.

        ``knows_tools`` is whether detection has looked for the tools' pairs at the start of this step.
        """
        if self._system.rows.n_contacts > 0:
            self._system.solve(self._iterations, dt_s)
        else:
            self._system.rest()
        self._plan_again(dt_s)
        self._give_forces(dt_s, knows_tools=knows_tools)

    def _add_motion(self, dt_s: float) -> None:
        for effect in self._stages["add_motion"]:
            effect.add_motion(self._world, dt_s)

    def _set_friction(self, dt_s: float) -> None:
        for effect in self._stages["set_friction"]:
            effect.set_friction(self._world, dt_s)

    def _assemble(self, dt_s: float) -> None:
        adds = self._stages["add_compliance"]
        self._system.assemble((lambda: self._add_compliance(dt_s)) if adds else None)

    def _add_compliance(self, dt_s: float) -> None:
        for effect in self._stages["add_compliance"]:
            effect.add_compliance(self._world, dt_s)

    def _plan_again(self, dt_s: float) -> None:
        """Plan the catheter's step again, and solve again, while the forces found bend it far from its plan.

        A plan with the forces that the last one led to need not be better: in a catheter that buckles they alternate.
        So it is kept only if it is, and else one half as far from the last is tried.
        """
        least_j = self._system.strays()
        if least_j == 0.0:
            return
        catheter = self._world.catheter
        catheter.keep_plan()
        share = 1.0
        for _ in range(MOST_PLANS):
            stray_j = self._try_plan(share, dt_s)
            if stray_j == 0.0:
                return
            if stray_j < least_j:
                catheter.keep_plan()
                least_j, share = stray_j, 1.0
            else:
                share *= 0.5
        if share < 1.0:
            self._try_plan(0.0, dt_s)

    def _try_plan(self, share: float, dt_s: float) -> float:
        self._system.plan_again(share)
        if self._system.rows.n_contacts:
            self._assemble(dt_s)
            self._system.solve(self._iterations, dt_s)
        return self._system.strays()

    def _give_forces(self, dt_s: float, *, knows_tools: bool) -> None:
        """Give the forces found to the bodies; where that meets what no row was for, take them back and solve again."""
        look = self.second_look
        look.prepare()
        self._give()
        for _ in range(look.most):
            if not look.is_due():
                return
            has_met = look.append_rows(knows_tools=knows_tools)
            if has_met:
                self._solve_with_new_rows(dt_s)
                look.prepare()  # the catheter may have been planned again, and ends elsewhere without forces
            self._give()
            if not has_met:
                return

    def _give(self) -> None:
        self._world.squeeze.react()
        self._system.apply(self.tool_force)

    def _solve_with_new_rows(self, dt_s: float) -> None:
        self._add_motion(dt_s)
        with self._system.old_friction():
            self._set_friction(dt_s)
        self._assemble(dt_s)
        self._system.solve(self._iterations, dt_s)
        self._plan_again(dt_s)
