"""Whether VTK can draw here: where a library of the system is missing, it ends Python by a signal."""

from __future__ import annotations

import ctypes
import functools
import os
import sys

from trocar.services.start.off_screen import draws_off_screen

#: By the library that VTK opens: Debian's package. Without a display it tries X first, and then EGL.
_X11 = {"libX11.so.6": "libx11-6"}
_EGL = {"libEGL.so.1": "libegl1"}
#: What VTK takes when neither could be opened; it draws by a library that no distribution ships any more.
_LAST_RESORT, _ITS_LIBRARY = "vtkOSOpenGLRenderWindow", "libOSMesa.so.8"


class CannotDrawError(RuntimeError):
    """This system lacks what drawing a picture needs; the sentence names what is to be installed."""


@functools.cache
def check_graphics_libraries() -> None:
    """Check that a picture can be drawn in this process.

    Raises CannotDrawError; ModuleNotFoundError without VTK.
    """
    if sys.platform != "linux":
        return
    from vtkmodules import vtkRenderingOpenGL2  # noqa: F401 - the factory knows its windows by this
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    needed = _EGL if draws_off_screen(os.environ) else _X11 | _EGL
    for library, package in needed.items():
        if not _opens(library):
            raise CannotDrawError(f"drawing a picture needs {library}, which this system lacks: apt install {package}")
    if vtkRenderWindow().GetClassName() == _LAST_RESORT and not _opens(_ITS_LIBRARY):
        raise CannotDrawError(
            "drawing a picture needs a driver of EGL or a display, and this system has neither: "
            "apt install libegl-mesa0 libgl1-mesa-dri"
        )


def _opens(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
