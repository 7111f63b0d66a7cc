"""Pictures that are drawn off the screen, and films of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
CODEC, PIXELS = "libx264", "yuv420p"
#: Every so many pictures one is whole, so that a learner finds any of them quickly.
_KEY_PICTURES = 2


def write_pictures(path: Path, pictures: Iterable[Image], rate_hz: int) -> None:
    """Write pictures (height, width, 3) of one size as a film; each can be found by its time."""
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as film:
        stream = film.add_stream(CODEC, rate=rate_hz, options={"g": str(_KEY_PICTURES)})
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
