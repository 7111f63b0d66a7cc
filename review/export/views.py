"""Views of a scene that are drawn off the screen, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scene import SceneModel
from trocar.services.visualization.picture import Picture, PictureLayout

Size = tuple[int, int]


class OffScreenRenderer(Protocol):
    """What draws pictures of one size off the screen."""

    def update(self, layout: PictureLayout, picture: Picture) -> None:
        """Take a picture and its layout."""

    def image(self) -> npt.NDArray[np.uint8]:
        """Return the picture (height, width, 3)."""

    def close(self) -> None:
        """Give up what is held."""


def open_renderer(view: str, size: Size, scene: SceneModel) -> OffScreenRenderer:
    """Return what draws a view of a scene. Raises ModuleNotFoundError: the view needs pyvista."""
    return VIEWS[view](size, scene)


def _scope(size: Size, _scene: SceneModel) -> OffScreenRenderer:
    from trocar.services.visualization.render import Renderer

    return Renderer(off_screen=True, size=size)


def _fluoroscope(size: Size, _scene: SceneModel) -> OffScreenRenderer:
    from trocar.review.export.fluoroscopy import Fluoroscope

    return Fluoroscope(size)


def _cholangioscope(size: Size, scene: SceneModel) -> OffScreenRenderer:
    """Return the view with contrast; in a duct that is cut the mouth is the gallbladder's neck, which is tied."""
    from trocar.review.export.cholangiogram import Cholangioscope

    tied = frozenset({"mouth"} if scene.duct.incision is not None else ())
    gravity = scene.effects.get("gravity")
    weighs_m_s2 = gravity.acceleration_m_s2 if isinstance(gravity, GravitySettings) else (0.0, 0.0, 0.0)
    return Cholangioscope(size, tied, scene.catheter.bubbles, weighs_m_s2)


VIEWS: dict[str, Callable[[Size, SceneModel], OffScreenRenderer]] = {
    "scope": _scope,
    "fluoroscopy": _fluoroscope,
    "cholangiogram": _cholangioscope,
}
