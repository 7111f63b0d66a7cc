"""Pictures of a scene that are drawn off the screen, and films of them; most views need pyvista (``trocar[view]``)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from trocar.protocol import Frame
from trocar.review.export.views import FilmView
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.errors import MissingPackageError
from trocar.services.visualization.composer import Composer
from trocar.services.visualization.picture import Picture, PictureLayout

Image = npt.NDArray[np.uint8]
CODEC, PIXELS = "libx264", "yuv420p"
#: Every so many pictures one is whole, so that a learner finds any of them quickly.
KEY_PICTURES = 2


class _Newest:
    """A bus with only the newest frames, as a picture asks it for them."""

    def __init__(self) -> None:
        self.frames: Mapping[str, Frame] = {}

    def sample(self, topics: Iterable[str], _until_ns: int) -> Mapping[str, Frame]:
        return {topic: self.frames[topic] for topic in topics if topic in self.frames}


class Camera:
    """A view of a scene, one of `views.FilmView`.

    Raises MissingPackageError that says what needs the package.

    Attributes:
        renderer: OffScreenRenderer. What draws the view.
    """

    def __init__(
        self,
        scene: SceneModel,
        name: str,
        duct: ReducedDuct,
        size: tuple[int, int],
        view: str = FilmView.SCOPE,
        needed_for: str = "an image",
    ) -> None:
        try:
            self.renderer = FilmView(view).open_renderer(size, scene)
        except ModuleNotFoundError as error:
            raise MissingPackageError(needed_for, error.name) from None
        self._bus = _Newest()
        self._composer = Composer(cast(Bus, self._bus), scene, name, duct)

    def image(self, frames: Mapping[str, Frame]) -> Image:
        """Return the picture (height, width, 3) of these frames."""
        self.renderer.update(*self.compose(frames))
        return np.array(self.renderer.image())

    def compose(self, frames: Mapping[str, Frame]) -> tuple[PictureLayout, Picture]:
        """Return what is drawn of these frames."""
        self._bus.frames = frames
        picture = self._composer.compose()
        return self._composer.layout, picture

    def close(self) -> None:
        """Close the renderer."""
        self.renderer.close()


def write_pictures(
    path: Path, pictures: Iterable[Image], rate_hz: int, key_pictures: int | None = KEY_PICTURES
) -> None:
    """Write pictures (height, width, 3) of one size as a film, each as it comes.

    Args:
        path: Path of the file.
        pictures: At least one.
        rate_hz: How many are shown a second.
        key_pictures: Every so many one is whole; None for as few as the codec takes.
    """
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    options = {} if key_pictures is None else {"g": str(key_pictures)}
    with av.open(str(path), "w") as film:
        stream = film.add_stream(CODEC, rate=rate_hz, options=options)
        for number, picture in enumerate(pictures):
            if number == 0:
                stream.height, stream.width, _ = picture.shape
                stream.pix_fmt = PIXELS
            film.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")))
        film.mux(stream.encode(None))


def film_info(size: tuple[int, int], rate_hz: int) -> dict[str, object]:
    """Return what LeRobot tells of a film of `write_pictures`, by height and width."""
    return {
        "video.height": size[0], "video.width": size[1], "video.codec": "h264", "video.pix_fmt": PIXELS,
        "video.is_depth_map": False, "video.fps": rate_hz, "video.channels": 3, "has_audio": False,
    }  # fmt: skip
