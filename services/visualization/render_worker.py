"""The rendering process: reads view messages on stdin, answers with images on stdout."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import io
import os
import sys

from PIL import Image

from trocar.services.runtime.errors import UserError
from trocar.services.visualization import codec
from trocar.services.visualization.picture import PictureLayout
from trocar.services.visualization.render import Renderer
from trocar.services.visualization.render_pipe import FRAME, HELLO, IMAGE, READ_BYTES, RENDER, Splitter, pack

_JPEG_QUALITY = 80  # assumption: a little above Pillow's default of 75, as a catheter has thin edges


def main() -> int:
    """Serve until stdin ends."""
    os.nice(max(0, 19 - os.nice(0)))
    try:
        renderer = Renderer(off_screen=True)
    except UserError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    layout: PictureLayout | None = None
    splitter = Splitter()
    while arrived := os.read(sys.stdin.fileno(), READ_BYTES):
        for kind, data in splitter.feed(arrived):
            if kind == HELLO:
                layout = codec.decode_hello(data.decode())
            elif kind == FRAME and layout is not None:
                renderer.update(layout, codec.decode(data, layout)[0])
            elif kind == RENDER:
                sys.stdout.buffer.write(pack(IMAGE, _encode(renderer, data.decode())))
                sys.stdout.buffer.flush()
    renderer.close()
    return 0


def _encode(renderer: Renderer, kind: str) -> bytes:
    stream = io.BytesIO()
    image = Image.fromarray(renderer.image())
    if kind == "jpeg":
        image.save(stream, "jpeg", quality=_JPEG_QUALITY)
    else:
        image.save(stream, "png", compress_level=1)
    return stream.getvalue()


if __name__ == "__main__":
    sys.exit(main())
