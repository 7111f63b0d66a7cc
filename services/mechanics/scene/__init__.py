"""Scenes as plain data, motions of hands, inputs and results of tools, and the recipe of a scene's duct.

`SceneModel` and its parts are imported at first use, because they name elements, which import sparse solvers: a gateway
that only needs the motion of a hand starts half a second earlier without them.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from trocar.services.mechanics.scene.instruments import DriveScene, ForcepsScene, ProbeScene, ToolScene, WireDriveScene

if TYPE_CHECKING:
    from trocar.services.mechanics.scene.catheter_section import CatheterSection
    from trocar.services.mechanics.scene.guide_wire import GuideWireScene
    from trocar.services.mechanics.scene.scene_model import (
        CatheterScene,
        ContactSettings,
        DuctScene,
        QualityLevel,
        SceneModel,
    )
else:

    def __getattr__(name: str) -> object:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module("trocar.services.mechanics.scene.scene_model"), name)


__all__ = [
    "CatheterScene",
    "CatheterSection",
    "ContactSettings",
    "DriveScene",
    "DuctScene",
    "ForcepsScene",
    "GuideWireScene",
    "ProbeScene",
    "QualityLevel",
    "SceneModel",
    "ToolScene",
    "WireDriveScene",
]
