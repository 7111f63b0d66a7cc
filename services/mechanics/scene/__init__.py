"""Scenes as plain data, how hands move, what they send in and get back, and what a scene says about its duct.

What a scene is made of is imported when it is asked for: it names elements, which bring sparse solvers; a gateway that
only wants to know how a hand moves is up half a second earlier without.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from services.mechanics.scene.instruments import ForcepsScene, ProbeScene, ToolScene

if TYPE_CHECKING:
    from services.mechanics.scene.model import (
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
        return getattr(import_module("services.mechanics.scene.model"), name)


__all__ = [
    "CatheterScene",
    "ContactSettings",
    "DuctScene",
    "ForcepsScene",
    "ProbeScene",
    "QualityLevel",
    "SceneModel",
    "ToolScene",
]
