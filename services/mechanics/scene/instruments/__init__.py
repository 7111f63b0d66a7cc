"""The table of instruments: the one place that names their kinds. A new kind is a file in this folder and a row here.

A row says what the scene file may say of it, what of it touches, whether it has jaws and a handle, and how it is drawn;
see `ToolScene`. Nothing here needs numpy, so that a process can read cheaply what a scene calls for.
"""

from __future__ import annotations

from services.mechanics.scene.instruments.drive import DriveScene
from services.mechanics.scene.instruments.forceps import ForcepsScene
from services.mechanics.scene.instruments.probe import ProbeScene
from services.mechanics.scene.instruments.tool import DrawnPart, ToolScene
from services.mechanics.scene.instruments.wire_drive import WireDriveScene

TOOLS: dict[str, type[ToolScene]] = {
    "forceps": ForcepsScene,
    "probe": ProbeScene,
    "drive": DriveScene,
    "wire_drive": WireDriveScene,
}
USUAL = "forceps"
"""Kind of a tool whose scene file names none."""

__all__ = ["TOOLS", "USUAL", "DrawnPart", "DriveScene", "ForcepsScene", "ProbeScene", "ToolScene", "WireDriveScene"]
