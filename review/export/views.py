"""Views of a scene that are drawn off the screen, by name: `FilmView` lists them."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol, Self

if TYPE_CHECKING:  # the command line lists the views without what draws them
    import numpy as np
    import numpy.typing as npt

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


def _scope(size: Size, _scene: SceneModel) -> OffScreenRenderer:
    from trocar.services.visualization.render import Renderer

    return Renderer(off_screen=True, size=size)


def _fluoroscope(size: Size, _scene: SceneModel) -> OffScreenRenderer:
    from trocar.review.export.fluoroscopy import Fluoroscope

    return Fluoroscope(size)


def _cholangioscope(size: Size, scene: SceneModel) -> OffScreenRenderer:
    """Return the view with contrast; in a duct that is cut the mouth is the gallbladder's neck, which is tied."""
    from trocar.review.export.cholangiogram import Cholangioscope
    from trocar.services.mechanics.effects.gravity import GravitySettings

    tied = frozenset({"mouth"} if scene.duct.incision is not None else ())
    gravity = scene.effects.get("gravity")
    weighs_m_s2 = gravity.acceleration_m_s2 if isinstance(gravity, GravitySettings) else (0.0, 0.0, 0.0)
    return Cholangioscope(size, tied, scene.catheter.bubbles, weighs_m_s2)


class FilmView(StrEnum):
    """How a film is seen; each view by its name, with what opens a renderer of it."""

    opener: Callable[[Size, SceneModel], OffScreenRenderer]

    def __new__(cls, name: str, opener: Callable[[Size, SceneModel], OffScreenRenderer] | None = None) -> Self:
        """Make a member that is its name; one that has been made is asked for by its name alone."""
        assert opener is not None
        view = str.__new__(cls, name)
        view._value_, view.opener = name, opener
        return view

    SCOPE = "scope", _scope
    FLUOROSCOPY = "fluoroscopy", _fluoroscope
    CHOLANGIOGRAM = "cholangiogram", _cholangioscope

    def open_renderer(self, size: Size, scene: SceneModel) -> OffScreenRenderer:
        """Return what draws this view of a scene. Raises ModuleNotFoundError: the view needs pyvista."""
        return self.opener(size, scene)
