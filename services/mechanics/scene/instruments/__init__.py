"""The table of instruments, the only place that names their kinds. A new kind is a file in this folder and a row here.

A row defines the keys of a scene file, which parts have contact, whether there are jaws and a handle, and the drawing;
see `ToolScene`. Nothing here needs numpy, so that a process can read a scene's instruments cheaply.
"""

from __future__ import annotations

from trocar.services.mechanics.scene.instruments.drive import DriveScene
from trocar.services.mechanics.scene.instruments.forceps import ForcepsScene
from trocar.services.mechanics.scene.instruments.probe import ProbeScene
from trocar.services.mechanics.scene.instruments.tool import DrawnPart, ToolScene
from trocar.services.mechanics.scene.instruments.wire_drive import WireDriveScene

TOOLS: dict[str, type[ToolScene]] = {
    "forceps": ForcepsScene,
    "probe": ProbeScene,
    "drive": DriveScene,
    "wire_drive": WireDriveScene,
}
USUAL = "forceps"
"""Default kind of a tool."""

__all__ = ["TOOLS", "USUAL", "DrawnPart", "DriveScene", "ForcepsScene", "ProbeScene", "ToolScene", "WireDriveScene"]
