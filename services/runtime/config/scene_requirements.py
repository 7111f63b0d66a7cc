"""A scene's requirements of a rig: processes, instruments and topics.

They are read from the scene file without the mechanics, so that processes without mechanics need not load them; only
the table of instruments is used, for handles. The processes that use the scene check the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from trocar.protocol.topics import TOPICS
from trocar.services.mechanics.scene.instruments import TOOLS, USUAL
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import InstrumentSettings, Rig

#: Processes that only serve tools and catheter; physics has its own clock without them.
OF_CONTACT = ("gateway", "haptics", "training")


@dataclass(frozen=True, slots=True)
class SceneRequirements:
    """The requirements of one scene.

    Attributes:
        duct_alone: Whether the scene has only a duct.
        tools: The kinds of the tools, None for the default.
    """

    duct_alone: bool = False
    tools: tuple[str, ...] | None = None

    @property
    def idle(self) -> tuple[str, ...]:
        """The processes that are not needed."""
        return OF_CONTACT if self.duct_alone else ()

    def is_published(self, topic: str) -> bool:
        """Return whether some process publishes a topic."""
        return TOPICS[topic].publisher not in self.idle

    def is_read(self, topic: str) -> bool:
        """Return whether some process, or an observer that is none of the rig's, might read a topic."""
        named = (*TOPICS[topic].readers, *TOPICS[topic].observers)
        return not named or any(process not in self.idle for process in named)

    def fitted(self, rig: Rig) -> Rig:
        """Return the rig without processes, instruments, handles and contracts that the scene does not need."""
        if self.duct_alone:
            return _without_contact(rig)
        if self.tools is None:
            return rig
        held = tuple(_fitted(row, kind) for row, kind in zip(rig.gateway.instruments, self.tools, strict=False))
        return rig.model_copy(update={"gateway": rig.gateway.model_copy(update={"instruments": held})})


EVERYTHING = SceneRequirements()
BESIDE_THE_DUCT = {"catheter", "forceps", "contact"}
"""Keys of a scene of which one of only a duct has none."""


def _fitted(row: InstrumentSettings, kind: str) -> InstrumentSettings:
    """Return an instrument, without its handle's drive if the tool has no handle."""
    has_handle = kind not in TOOLS or TOOLS[kind].has_handle
    return row if has_handle or row.grasp is None else row.model_copy(update={"grasp": None})


def _without_contact(rig: Rig) -> Rig:
    idle = {name: rig.process(name).model_copy(update={"enabled": False}) for name in OF_CONTACT}
    loops = {name: loop for name, loop in rig.contracts.loops.items() if name not in OF_CONTACT}
    contracts = rig.contracts.model_copy(update={"loops": loops, "paths": {}})  # every path begins at a device
    gateway = rig.gateway.model_copy(update={"instruments": ()})
    return rig.model_copy(update={"processes": {**rig.processes, **idle}, "contracts": contracts, "gateway": gateway})


def has_duct_alone(data: Mapping[str, Any]) -> bool:
    """Return whether a scene has only a duct."""
    return "duct" in data and not BESIDE_THE_DUCT & data.keys()


def scene_requirements(scene: str, overrides: Iterable[str] = ()) -> SceneRequirements:
    """Return the requirements of a scene, by path or by name in configs/scenes.

    Raises ConfigError if there is no such scene, or it is not YAML.
    """
    data = config.read_scene(scene, overrides)
    named = data.get("forceps")
    if not isinstance(named, list):
        return SceneRequirements(has_duct_alone(data))
    kinds = tuple(str(each.get("kind", USUAL)) if isinstance(each, Mapping) else USUAL for each in named)
    return SceneRequirements(has_duct_alone(data), kinds)
