"""Scenes as plain data, how hands move, what they send in and get back, and what a scene says about its duct."""

from services.mechanics.scene.model import (
    CatheterScene,
    ContactSettings,
    DuctScene,
    ForcepsScene,
    QualityLevel,
    SceneModel,
)

__all__ = ["CatheterScene", "ContactSettings", "DuctScene", "ForcepsScene", "QualityLevel", "SceneModel"]
