"""Simulation of a scene, one tick at a time: duct, catheter and two tools."""

from __future__ import annotations

import math
from operator import add, sub
from time import perf_counter_ns
from typing import Protocol

import numpy as np

from trocar.services.mechanics.arrays import ByteArray, FloatArray
from trocar.services.mechanics.bodies.catheter_drive import build_drive
from trocar.services.mechanics.bodies.duct_loads import begin_loads
from trocar.services.mechanics.bodies.forceps import Grasp, JawState
from trocar.services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from trocar.services.mechanics.bodies.lumen import MovingLumen
from trocar.services.mechanics.bodies.wire_drive import build_wire_drive
from trocar.services.mechanics.collision.pairs import ContactPairs
from trocar.services.mechanics.contact.candidate_search import CandidateSearch
from trocar.services.mechanics.contact.engagement import set_rest_offsets
from trocar.services.mechanics.contact.local_stiffness import LocalStiffness
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.system import DroppedContacts
from trocar.services.mechanics.contact.tool_loads import report
from trocar.services.mechanics.contact.working_set import tolerated_overlap_m
from trocar.services.mechanics.effects import act, build_effects, by_stage
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.rod.free_step import continue_sleep
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.argument_checks import ArgumentChecks
from trocar.services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs, ToolResults
from trocar.services.mechanics.simulation.healing import Healer
from trocar.services.mechanics.simulation.inside_watch import InsideWatch
from trocar.services.mechanics.simulation.motion_share import MotionShare
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.mechanics.simulation.scene_world import build_world
from trocar.services.mechanics.simulation.sound_start import begin_sound
from trocar.services.mechanics.simulation.step_solver import StepSolver
from trocar.services.mechanics.simulation.step_splitting import LONGEST_STEP_S, SHORTEST_STEP_S, StepSplitter, steps_of
from trocar.services.mechanics.simulation.step_start import StepStart
from trocar.services.mechanics.simulation.stuck_world import StuckWorld

LONGEST_TICK_S = 1.0
INDEBTED_STEP_S = LONGEST_STEP_S / 8
"""Longest part in which contacts may give out more than their credit, if it can be divided. What they give beyond a
straight way falls with the square of the part: an eighth of a tick gives a 64th, all eight of them an eighth."""
STAGE_NAMES = ("loads", "predict", "detect", "assemble", "solve", "correct", "report")


class Watcher(Protocol):
    """Observes a simulation before and after each substep."""

    def begin(self) -> None:
        """Observe the state at the start of a substep."""

    def end(self, dt_s: float) -> None:
        """Observe the state after a substep of which so much time has happened."""


class Simulation:
    """A scene that moves in steps of one tick.

    `step` writes every public array in place, and allocates nothing whose size depends on mesh, catheter or contacts.

    Args:
        duct: ReducedDuct. From `build_scene_duct`, which lays the effects' constant loads into its rest shape.
        search: CandidateSearch, optional. Another collision detection.

    Attributes:
        is_felt: bool. Whether the report includes the local stiffness at each tool, which haptics needs.
        share: float. How much of its solved motion the last part of a step has kept.
        withheld_s: float. Simulated time since the start that did not happen, because no motion was sound.
        inside_watch: InsideWatch. Tells of a tool that is inside a body and has no contact: by a `ToolInsideWarning`.
    """

    def __init__(self, scene: SceneModel, duct: ReducedDuct, search: CandidateSearch | None = None) -> None:
        self.scene = scene = place_catheter(scene, duct.mesh)
        self.effects = build_effects(scene)
        stages = by_stage(self.effects.values())
        self.world = world = build_world(scene, duct, tuple(self.effects.values()), search)
        self.duct, self.catheter, self.tools = self._moving = world.duct, world.catheter, world.tools
        self.system, self.holds, self.search = world.system, world.holds, world.search
        for effect in stages["place_bodies"]:
            effect.place_bodies(world)
        begin_sound(world)
        self.seal, self.squeeze = world.seal, world.squeeze
        self.grasps = tuple(
            Grasp(tool, each.jaws, duct.mesh, scene.catheter)
            for tool, each in enumerate(scene.forceps)
            if each.jaws is not None
        )
        self.drive = build_drive(scene, self._moving[1:], self.holds.lost)
        self.wire_drive = build_wire_drive(scene, self._moving[1:])
        self.tool_results = felt = ToolResults()
        proxy = felt.proxy_position_m, felt.proxy_jaw_angle_rad
        self._report = felt.force_n, felt.port_moment_nm, felt.grasp_torque_nm, *proxy
        self.max_penetration_m, self.is_felt = 0.0, True
        self._lumen = MovingLumen(duct, self.catheter.properties.n_particles)
        self._tool_force = np.zeros((N_TOOLS, N_COORDINATES))
        self._stiffness = LocalStiffness(self.system.bodies, self.system.address, self.tool_results)
        self.cost_ns, self._arguments = [0] * len(STAGE_NAMES), ArgumentChecks()
        self._marks_ns = [0] * (len(STAGE_NAMES) - 1)
        self.splitter, self.withheld_s, self.share = StepSplitter(world), 0.0, 1.0
        self._owes_nothing = True  # whether effects owe no energy for the last part, see `Effect.is_settled`
        self._is_indebted = False  # whether its contacts do, and it is longer than `INDEBTED_STEP_S`
        self.watcher: Watcher | None = None
        self.inside_watch = InsideWatch(N_TOOLS)
        for effect in stages["prepare"]:
            effect.prepare(world)
        self.solver = StepSolver(world, self._tool_force)
        self._start = StepStart(
            world,
            [*self.grasps, *(drive for drive in (self.drive, self.wire_drive) if drive is not None)],
            self._tool_force,
        )
        self._motion_share = MotionShare(world, self._start)
        self._healer = Healer(world, self._start)
        self._stuck = StuckWorld(world, tolerated_overlap_m(scene.duct.thickness_m))
        for name in scene.quality[0].without:
            self.effects[name].rest()
        self._use_rung(0)

    def step(self, tools: ToolInputs, dt_s: float = 1e-3) -> None:
        """Advance everything by one tick.

        Raises TypeError or ValueError if ``dt_s`` is not positive and finite, or too long, or if an array has the wrong
        shape or dtype (`ArgumentChecks`). The state is then unchanged.

        Args:
            tools: ToolInputs. The hands at the end of the tick.
            dt_s: float. Length of the tick, at most `LONGEST_TICK_S`. A tick longer than a millisecond, or than the
                step that the quality level allows, is split into steps.
        """
        if not 0.0 < dt_s < math.inf:
            raise ValueError(f"dt_s must be positive and finite, is {dt_s}")
        if dt_s > LONGEST_TICK_S:
            raise ValueError(f"dt_s must be at most {LONGEST_TICK_S:g} s, is {dt_s:g}")
        self._arguments.check(tools)
        self.solver.products = 0.0
        self.cost_ns[:] = [0] * len(STAGE_NAMES)
        if self._healer.must_heal():
            self._heal()
        else:
            self._take_tick(tools, dt_s)
        start_ns = perf_counter_ns()
        self.write_report()
        self.cost_ns[-1] = perf_counter_ns() - start_ns
        self.inside_watch.look(self.tools.present.tolist(), self.tools.disengaged.tolist())
        if self._fading and all(effect.rests for effect in self._fading):
            self._use_rung(self.quality_level)

    def compile_rare_kernels(self) -> None:
        """Compile the kernels for many contacts, fast walls, unsound ends, sleep, grasps, energies and terms.

        Physics uses them. Haptics compiles them too, in the same order, so that physics finds them in the cache.
        """
        self.system.strategy.assemble(anew=True)  # as if blocks of the wall's compliance were missing
        self.splitter.compile_kernels()
        self.search.depths_m(self.system, 1.0)
        self.squeeze.compile_kernels(self.search)
        for effect in self.world.effects:
            effect.potential_energy_j(self.world)
        if self.duct.terms is not None:
            self.duct.terms.compile_rare_kernels()
        for grasp in self.grasps:
            grasp.compile_kernels(self.world.pairs)
        state = self.catheter.state
        continue_sleep(self.catheter.step_address, state.position_m, state.velocity_m_s)

    def _take_tick(self, tools: ToolInputs, dt_s: float) -> None:
        """Advance by a tick in steps, and by each of these in as many parts as it needs."""
        self.tools.appear(tools)
        if not self._stuck.begin(tools) or self._fading:
            self._forget_tries()
        steps = steps_of(dt_s, self.rung.ticks_per_step * LONGEST_STEP_S)
        for _ in range(steps):
            parts = self.splitter.parts(tools, dt_s / steps)
            self._take_parts(tools, dt_s / steps / parts, parts)

    def _take_parts(self, tools: ToolInputs, dt_s: float, parts: int) -> None:
        for _ in range(parts):
            self._take_part(tools, dt_s)

    def _take_part(self, tools: ToolInputs, dt_s: float) -> None:
        """Advance by a substep.

        One that is not accepted is taken back to its largest sound share, and the rest of its time follows in parts of
        its own; if less than half of it is sound, it is taken in halves, down to the shortest. Time that is left when
        the tick's products are spent, or by one of the shortest, does not happen. What has failed from here is not
        tried again.
        """
        if self._stuck.fails(dt_s) and dt_s > SHORTEST_STEP_S:
            self._take_parts(tools, dt_s / 2, 2)
            return
        if self.solver.is_spent or self._stuck.fails(dt_s):
            self.share = 0.0
            self.system.bring_rows_back()
            self.withheld_s += dt_s
            return
        self.duct.change_step(dt_s)
        if self.watcher is not None:
            self.watcher.begin()
        self._start.save()
        self.share, found = 1.0, self.solver.pricing.n_found
        if not self._move(tools, dt_s):
            self.share = self._find_share(dt_s)
            if self.solver.pricing.n_found == found:
                self._stuck.note_failed(dt_s)
            may_divide = dt_s > SHORTEST_STEP_S and not self.solver.is_spent
            may_stand = self._owes_nothing and self.solver.prices and not self._is_indebted
            if may_divide and (self.share < 0.5 or not may_stand):
                self._start.restore()
                self._take_parts(tools, dt_s / 2, 2)
                return
            if self._is_indebted:
                self.share = 0.0
            self._take_back()
        share = self.share
        if share > 0.0:
            self._correct(dt_s)
            self.system.keep_rows()
            self._forget_tries()
        else:
            self._stuck.note_rest(tools)
        if self.watcher is not None:
            self.watcher.end(share * dt_s)
        if share < 1.0:
            self._go_on(tools, dt_s, share)

    def _forget_tries(self) -> None:
        """Forget what tries from the last start have found, because what follows begins elsewhere."""
        self._stuck.forget()
        self.solver.pricing.forget_known()

    def _find_share(self, dt_s: float) -> float:
        """Return how much of the solved motion is sound, in whole shortest parts or eighths, whichever is more.

        In eighths, because a motion of ever smaller shares would never end. None of a motion to an impossible state is,
        nor of one that has given out energy that was not there.

        Without prices nothing tells how deep bodies are at a share: all of it counts.
        """
        if not (self._owes_nothing and self._healer.accepts()):
            return 0.0
        if not self.solver.prices:
            return 1.0
        quantum = max(0.125, SHORTEST_STEP_S / dt_s) if dt_s >= 2.0 * SHORTEST_STEP_S else 0.125
        share = self._motion_share.find(self.solver.pricing.tolerance_m, self.splitter.detected_share, quantum)
        self.solver.charge_looks(self._motion_share.looks)
        return share

    def _take_back(self) -> None:
        """Take the motion of a part back to its sound share; at none of it, everything rests where it was."""
        share = self.share
        if share == 0.0:
            self._start.restore()
            self.system.bring_rows_back()
            self.duct.halt()
            self.catheter.state.halt()
        elif share < 1.0:
            self._motion_share.take(share)
            for effect in self.effects.values():
                effect.take_back(self.world, share)

    def _go_on(self, tools: ToolInputs, dt_s: float, share: float) -> None:
        """Take the rest of a part of which a share has happened; one of the shortest has none."""
        left_s = (1.0 - share) * dt_s
        if share == 0.0 or dt_s < 2.0 * SHORTEST_STEP_S:
            self.withheld_s += left_s
            return
        part_s = dt_s
        while left_s > 1e-6 * dt_s:
            part_s *= 0.5
            if left_s > (1.0 - 1e-6) * part_s:
                left_s -= part_s
                self._take_part(tools, part_s)

    def _move(self, tools: ToolInputs, dt_s: float) -> bool:
        """Move everything by a substep; return whether its end is possible, and without overlap or debt.

        Nothing may have moved further than detection looks ahead.
        """
        marks = self._marks_ns
        marks[0] = perf_counter_ns()
        begin_loads(self.duct.motion_address, self.catheter.step_address)
        act(self._stages, "add_loads", self.world, dt_s)
        marks[1] = perf_counter_ns()
        self.duct.predict(dt_s)
        if self.drive is not None:
            self.drive.turn()
        self.holds.write_jaw_stops(self.tools)
        self.tools.predict(tools, dt_s)
        if self.wire_drive is not None:
            self.wire_drive.move(dt_s)
        self.catheter.predict(dt_s)
        marks[2] = perf_counter_ns()
        self._collect(tools, dt_s)
        marks[3] = perf_counter_ns()
        if self.system.rows.n_contacts > 0:
            self.solver.prepare(dt_s)
        marks[4] = perf_counter_ns()
        is_settled = self.solver.solve(dt_s)
        act(self._stages, "settle", self.world, dt_s)
        self._owes_nothing = all(effect.is_settled for effect in self._stages["settle"])
        self._is_indebted = not self.system.owes_nothing and dt_s > INDEBTED_STEP_S
        marks[5] = perf_counter_ns()
        self.cost_ns[:5] = map(add, self.cost_ns, map(sub, marks[1:], marks))
        is_sound = is_settled and self._owes_nothing and not self._is_indebted
        return self.splitter.is_detected() and is_sound and self._healer.accepts()

    def _heal(self) -> None:
        """Put back the state that the last step began with; no force acts on a tool in this tick."""
        self._healer.heal()
        for grasp in self.grasps:
            grasp.let_go()
        if self.wire_drive is not None:
            self.wire_drive.let_go()
        self._tool_force[:] = 0.0
        self.share = 1.0
        self._use_rung(self.quality_level)

    @property
    def contacts(self) -> ContactRows:
        """Contacts and holds of the last step with their solved forces."""
        return self.system.rows

    @property
    def contact_force_n(self) -> FloatArray:
        """(k, 3) solved forces on the first bodies, along world axes."""
        return self.system.force_n[: self.system.rows.n_contacts]

    @property
    def dropped_contacts(self) -> DroppedContacts:
        """Contacts lost for lack of capacity since the start; such a scene needs a larger ``contact.capacity``."""
        system = self.system
        pairs = system.dropped_pairs + self.search.dropped
        return DroppedContacts(pairs, system.rows.dropped, self.holds.dropped)

    @property
    def refused_inputs(self) -> int:
        """Number of tool inputs and holds ignored since the start for invalid numbers, counted in each step."""
        return self.tools.refused + self.holds.refused

    @property
    def healed_states(self) -> int:
        """Number of impossible states that callers have set since the start, and that were put back."""
        return self._healer.healed

    @property
    def stage_cost_ns(self) -> dict[str, int]:
        """Time that each stage of the last step took."""
        return dict(zip(STAGE_NAMES, self.cost_ns, strict=True))

    @property
    def inserted_length_m(self) -> float:
        """Length of catheter in the lumen, from the opening it entered by to its tip; 0 while the tip is outside."""
        catheter = self.catheter
        segment_m = catheter.properties.segment_length_m
        return self._lumen.inserted_length_m(self.duct.state.q, catheter.state.position_m, segment_m)

    @property
    def entered_by(self) -> str:
        """Name of the opening by which the catheter entered the lumen; empty while its tip is outside."""
        self._lumen.follow(self.duct.state.q, self.catheter.state.position_m)
        return self._lumen.entered_by

    @property
    def inside(self) -> ByteArray:
        """(n,) one where a particle of the catheter is in the lumen."""
        self._lumen.follow(self.duct.state.q, self.catheter.state.position_m)
        return self._lumen.inside

    def set_quality(self, level: int) -> None:
        """Switch to a level of the scene's quality ladder; states are kept, so nothing jumps."""
        if not 0 <= level < len(self.scene.quality):
            raise ValueError(f"quality level {level} is not within 0 and {len(self.scene.quality) - 1}")
        before, then = set(self.rung.without), set(self.scene.quality[level].without)
        for name in before - then:
            self.effects[name].wake()
        for name in then - before:
            self.effects[name].rest()
        self._use_rung(level)

    def _use_rung(self, level: int) -> None:
        """Activate the effects of a quality level, and keep active those that are still fading out."""
        self.quality_level, self.rung = level, self.scene.quality[level]
        self._arguments = ArgumentChecks()
        self._fading = [self.effects[name] for name in self.rung.without if not self.effects[name].rests]
        acting = [e for name, e in self.effects.items() if e in self._fading or name not in self.rung.without]
        self._stages = by_stage(acting)
        self.solver.use(self._stages, self.rung.iterations)
        self._forget_tries()

    def _collect(self, tools: ToolInputs, dt_s: float) -> None:
        """Make contact rows of the selected candidates and of the holds."""
        system, search = self.system, self.search
        system.remove_vanished_tools()
        system.clear()
        self.seal.append_row()
        self.squeeze.append_rows()
        pairs = self.world.pairs
        pairs.clear()
        search.begin(system)
        search.write_pairs(system.address, pairs)
        wanted = self._grasp(tools, pairs) if tools.holds is None else tools.holds
        self.holds.follow(wanted if self.drive is None else [*wanted, *self.drive.holds()])
        if self.holds.has_begun:
            set_rest_offsets(pairs.address, system.geometry.address, tools.holds is not None)
        system.append(pairs)
        act(self._stages, "add_rows", self.world, dt_s)
        self.holds.append_rows()
        self.solver.pricing.append_known()

    def _grasp(self, tools: ToolInputs, pairs: ContactPairs) -> list[GraspHold]:
        """Update the grasps of the tools with jaws; an absent or waiting tool holds nothing."""
        held: list[GraspHold] = []
        for grasp in self.grasps:
            tool = grasp.tool
            if self.tools.present[tool] and not self.tools.disengaged[tool]:
                jaws = JawState(float(self.tools.proxy[tool, 3]), float(tools.jaw_angle_rad[tool]))
                held += grasp.update(pairs, jaws)
            else:
                grasp.let_go()
        return held

    def _correct(self, dt_s: float) -> None:
        """Update everything that depends on the solved motion: slip of seal and holds, squeezed wall, effects."""
        start_ns = perf_counter_ns()
        if self.wire_drive is not None:
            self.wire_drive.settle()
        self.seal.slide(self.share)
        self.holds.slide(self.share)
        self.search.update_working_set(self.system.address)
        if self.wire_drive is not None:
            self.wire_drive.give(self._tool_force)
        self.squeeze.update(dt_s, self.search)
        act(self._stages, "after_solve", self.world, dt_s)
        self.cost_ns[-2] += perf_counter_ns() - start_ns

    def write_report(self) -> None:
        """Write what the tools feel at the end of a tick, whatever its number of substeps.

        Of a part of which nothing has happened nothing is felt: forces are those before it, and so is the stiffness.
        """
        self.max_penetration_m = report(self.system.address, self._tool_force, self._report)
        if self.system.strategy.keeps_delassus and self.is_felt and self.share > 0.0:
            self._stiffness.write()
        if self.wire_drive is not None:
            self.wire_drive.felt_stiffness(self.tool_results.stiffness_n_m)
