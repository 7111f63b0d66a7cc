"""The loop of physics for a scene of only a duct: it has its own clock, and publishes the wall."""

from __future__ import annotations

import time
from operator import add

import numpy as np

from trocar.protocol.arrays import pack
from trocar.protocol.bodies import Catheter, ContactForces, Duct, PhysicsState
from trocar.protocol.bodies.physics import reaction_table
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation.duct_alone import STAGE_NAMES, DuctAlone
from trocar.services.physics.outputs import pack_contiguous
from trocar.services.runtime.loop.loop import CATCH_UP, LoopMeter, Tick, ticks
from trocar.services.runtime.loop.nan_guard import NanGuard
from trocar.services.runtime.process.process import Process

STAGES = (*STAGE_NAMES, "send")
_NO_TOOLS = reaction_table(())
_VECTORS = pack(np.zeros((0, 3)), "<f8")
#: The wire format requires a radius even without particles.
_NO_CATHETER = Catheter(position_m=_VECTORS, velocity_m_s=_VECTORS, radius_m=1e-3)
_NO_CONTACTS = ContactForces(kind=pack(np.zeros(0, np.int8), "|i1"), point_m=_VECTORS, force_n=_VECTORS)
_NO_NODES = pack(np.zeros(0, np.int32), "<i4")


class DuctAlonePhysics:
    """A duct on the bus. A state with a NaN is written to a file and replaced by the scene at rest."""

    def __init__(self, process: Process, meter: LoopMeter, scene: SceneModel, duct: ReducedDuct) -> None:
        self._process, self._meter = process, meter
        self._scene, self._duct = scene, duct
        self._steps_to = -1
        self.resets = 0
        self._begin()

    def _begin(self) -> None:
        self.simulation = DuctAlone(self._scene, self._duct)
        self._guard = NanGuard("physics", {"q": self.simulation.state.q}, cache_directory() / "dumps")

    def advance(self, tick: Tick) -> None:
        """Take the steps up to a tick, including a few lost ones, and publish the last state."""
        costs_ns = [0] * len(STAGE_NAMES)
        healthy = True
        jump = tick.index - self._steps_to
        for _ in range(jump if jump <= CATCH_UP else 1):
            self.simulation.step()
            costs_ns[:] = map(add, costs_ns, self.simulation.cost_ns)
            healthy = healthy and self._guard.watch()
        self._steps_to = tick.index
        if not healthy:
            self._reset()
        stepped_ns = time.monotonic_ns()
        self._process.bus.publish("physics.state", self.state(tick.index), origin_ns=tick.started_ns, valid=healthy)
        self._meter.stages_ns = (*costs_ns, time.monotonic_ns() - stepped_ns)

    def state(self, tick: int) -> PhysicsState:
        """Return the message after a step."""
        modes = self.simulation.state
        content_hash = self._duct.basis.content_hash
        return PhysicsState(
            tick=tick,
            tools=_NO_TOOLS,
            duct=Duct(
                basis_hash=content_hash,
                q=pack_contiguous(modes.q),
                q_rate=pack_contiguous(modes.qdot),
                load_node=_NO_NODES,
                load_force_n=_VECTORS,
            ),
            catheter=_NO_CATHETER,
            contacts=_NO_CONTACTS,
        )

    def _reset(self) -> None:
        self.resets += 1
        self._process.health.gauges["resets"] = float(self.resets)
        self._process.log.error("a state is not a number: wrote %s and began anew", self._guard.dumps[-1])
        self._begin()


def run_duct_alone(process: Process, meter: LoopMeter, scene: SceneModel, duct: ReducedDuct) -> None:
    """Step in each tick of the process' own clock."""
    physics = DuctAlonePhysics(process, meter, scene, duct)
    process.ready(meter)
    process.health.change("running")
    for tick in ticks(meter, process.stop):
        physics.advance(tick)
        process.bus.flush()
        process.bus.drain("supervisor.state")  # requests are ignored: a lower quality would save nothing
        process.health.do_a_piece()
