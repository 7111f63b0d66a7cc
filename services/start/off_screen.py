"""VTK's choice between drawing off the screen, by EGL, and a window of the display."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping

_VARIABLE, _EGL = "VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow"


def draw_off_screen(environment: MutableMapping[str, str]) -> None:
    """Let VTK draw off the screen in a process with this environment, unless that has chosen already.

    VTK reads the variable when it is loaded. Without it, VTK complains where there is no display.
    """
    environment.setdefault(_VARIABLE, _EGL)


def draws_off_screen(environment: Mapping[str, str]) -> bool:
    """Return whether that was chosen in a process with this environment."""
    return environment.get(_VARIABLE) == _EGL


def on_screen(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without that choice, in which a window would find no display."""
    return {name: value for name, value in environment.items() if name != _VARIABLE}
