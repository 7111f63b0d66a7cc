"""Paths of the page: its files, and the file about a run of the rig for those beside it. Needs no web package."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from trocar import services
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.private_directory import open_text

#: The built page, from services/visualization/web.
DIST = Path(services.__file__).parent / "visualization" / "web" / "dist"


class PageFile(msgspec.Struct, frozen=True, kw_only=True):
    """What commands, and the processes of the page and of the school, are told of a run of the rig.

    Args:
        address, token: Of the page.
        rig: The rig as JSON, with defaults and overrides.
        switches: Whether the session can switch to another scenario.
        fingerprint: Of the certificate by which the page is encrypted, empty without one.
        scene_overrides: Those of the command line.
        asked: What the rig was started with: the name of its file, and all overrides.
    """

    address: str
    token: str
    rig: str
    scene: str
    switches: bool = False
    fingerprint: str = ""
    scene_overrides: tuple[str, ...] = ()
    asked: tuple[str, tuple[str, ...]] = ("", ())


def page_file(transport: Transport) -> Path:
    """Return the path of the file; the folder is private to the user."""
    return endpoints.run_directory(transport) / "page.json"


def write_page_file(path: Path, content: PageFile) -> None:
    """Write the file, readable by this user only."""
    with open_text(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC) as file:
        file.write(msgspec.json.encode(content).decode())


def read_page_file(path: Path) -> PageFile:
    """Return the content of the file. Raises OSError, or ValueError if it is none."""
    with open_text(path) as file:
        return msgspec.json.decode(file.read(), type=PageFile)
