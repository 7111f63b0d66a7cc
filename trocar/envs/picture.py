"""Images of the scene, drawn off the screen; the endoscope's view needs pyvista (``trocar[view]``)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trocar.protocol import Frame
from trocar.review.export.fluoroscopy import open_renderer
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.errors import MissingPackageError
from trocar.services.start.off_screen import draw_off_screen
from trocar.services.visualization.composer import Composer


class _Newest:
    """A bus with only the newest frames."""

    def __init__(self) -> None:
        self.frames: Mapping[str, Frame] = {}

    def sample(self, _topics: Iterable[str], _until_ns: int) -> Mapping[str, Frame]:
        return self.frames


def recorded_camera(path: Path, view: str, size: tuple[int, int]) -> Camera:
    """Return a view of the scene of a recording.

    Raises RecordingError if its scene is not in it, MissingPackageError if a package is not installed.
    """
    from trocar.review.export.film import recorded_scene  # a verb's: its import changes the process

    draw_off_screen(os.environ)
    return Camera(*recorded_scene(path), size, view)


class Camera:
    """A view of a scene: the endoscope's, or X-ray-like (``fluoroscopy``)."""

    def __init__(
        self, scene: SceneModel, name: str, duct: ReducedDuct, size: tuple[int, int], view: str = "scope"
    ) -> None:
        try:
            self._renderer = open_renderer(view, size)
        except ModuleNotFoundError as error:
            raise MissingPackageError("an image", error.name) from None
        self._bus = _Newest()
        self._composer = Composer(self._bus, scene, name, duct)  # type: ignore[arg-type]

    def image(self, frames: Mapping[str, Frame]) -> npt.NDArray[np.uint8]:
        """Return the picture (height, width, 3) of these frames."""
        self._bus.frames = frames
        picture = self._composer.compose()
        self._renderer.update(self._composer.layout, picture)
        return np.array(self._renderer.image())

    def close(self) -> None:
        """Close the renderer."""
        self._renderer.close()
