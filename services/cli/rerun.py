"""A recorded simulation run again without a rig: the code of haptics and physics, fed tick by tick in one process."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import msgspec
import numpy as np

from trocar.protocol import Frame
from trocar.protocol.arrays import Array
from trocar.protocol.bodies import PhysicsState, ToolContacts
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics import __main__ as haptics
from trocar.services.haptics.replaying import STATES_KEPT
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.physics import __main__ as physics
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.injected_bus import InjectedProcess
from trocar.services.recordings.inputs import Intake, RecordedInputs
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.process.process import Process
from trocar.services.scenes import load_duct, load_scene


class Rerun:
    """Haptics and physics from the beginning of a simulation."""

    def __init__(self, scene: SceneModel, duct: ReducedDuct) -> None:
        self._haptics_process, self._physics_process = InjectedProcess(), InjectedProcess()
        meters = LoopMeter(haptics.RATE_HZ, haptics.STAGES), LoopMeter(physics.RATE_HZ, physics.STAGES)
        self._haptics = haptics.Haptics(cast(Process, self._haptics_process), meters[0], scene, duct)
        self._physics = physics.Physics(cast(Process, self._physics_process), meters[1], scene, duct)
        self._states: dict[int, Frame] = {}
        self._seen = -1

    def step(self, intake: Intake) -> tuple[ToolContacts | None, PhysicsState | None]:
        """Take in what was taken in at one tick; return what haptics told physics, and the state, where there is one.

        Raises RecordingError if haptics saw a state that was never made.
        """
        bus = self._haptics_process.bus
        if intake.seen_tick not in (-1, self._seen):
            if intake.seen_tick not in self._states:
                raise RecordingError(
                    f"tick {intake.tick}: haptics saw a state of tick {intake.seen_tick}, which is none"
                )
            bus.frame, self._seen = self._states[intake.seen_tick], intake.seen_tick
        bus.is_fresh_now = intake.is_fresh
        bus.said.clear()
        self._haptics.answer(intake.devices)
        contacts = bus.said.get("haptics.contacts")
        state = self._advance(contacts, intake) if contacts is not None and intake.ticks else None
        return contacts.body if contacts else None, state.body if state else None

    def _advance(self, contacts: Frame, intake: Intake) -> Frame | None:
        said = self._physics_process.bus.said
        said.clear()
        self._physics.obey(intake.level)
        self._physics.advance(contacts, intake.ticks)
        self._physics.do_side_work()
        state = said.get("physics.state")
        if state is not None:
            self._states[intake.tick] = state
            while len(self._states) > STATES_KEPT:
                del self._states[next(iter(self._states))]
        return state


@dataclass(slots=True)
class Comparison:
    """What came of running a recording again.

    Attributes:
        compared, alike: States and contacts that were kept, and those that are the same to the bit.
        first_difference: One sentence, empty for none.
        apart_m: How far the catheter's particles are from the recorded ones in the last state.
        has_other_modes: Whether another processor computed the modes of its wall: then no state is alike, and `apart_m`
            is what counts.
    """

    ticks: int = 0
    compared: int = 0
    alike: int = 0
    first_difference: str = ""
    apart_m: float = 0.0
    has_other_modes: bool = False


def load(inputs: RecordedInputs) -> tuple[SceneModel, ReducedDuct]:
    """Return scene and duct of a recording. Raises ConfigError if the scene cannot be used."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_bytes(inputs.attachments["scene.yaml"])
        scene = load_scene(path)
    return scene, load_duct(scene, cache_directory(), lambda _stage, _share: None)


def compare(inputs: RecordedInputs) -> Comparison:
    """Run a recording again and compare each state and each table of contacts that it kept."""
    scene, duct = load(inputs)
    rerun, found = Rerun(scene, duct), Comparison()
    found.has_other_modes = any(each.duct.basis_hash != duct.basis.content_hash for each in inputs.states.values())
    for intake in inputs.intakes:
        contacts, state = rerun.step(intake)
        found.ticks += intake.ticks
        for made, kept in ((contacts, inputs.contacts.get(intake.tick)), (state, inputs.states.get(intake.tick))):
            if made is None or kept is None:
                continue
            found.compared += 1
            found.alike += made == kept
            if made != kept and not found.first_difference:
                found.first_difference = f"tick {intake.tick}: {', '.join(_differences(made, kept))}"
            if isinstance(made, PhysicsState) and isinstance(kept, PhysicsState):
                apart = made.catheter.position_m.view() - kept.catheter.position_m.view()
                found.apart_m = float(np.max(np.linalg.norm(apart, axis=1), initial=0.0))
    return found


def _differences(made: msgspec.Struct, kept: msgspec.Struct, path: str = "") -> Iterator[str]:
    for name in made.__struct_fields__:
        ours, theirs = getattr(made, name), getattr(kept, name)
        if ours == theirs:
            continue
        if isinstance(ours, Array):
            a, b = ours.view(), theirs.view()
            most = f"by at most {np.max(np.abs(a - b)):.3g}" if a.shape == b.shape else f"{a.shape} for {b.shape}"
            yield f"{path}{name} differs {most}"
        elif isinstance(ours, msgspec.Struct):
            yield from _differences(ours, theirs, f"{path}{name}.")
        else:
            yield f"{path}{name} is {ours}, was {theirs}"
