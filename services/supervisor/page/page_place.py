"""Paths of the page: its files, and the file with its address and token. Needs no web package."""

from __future__ import annotations

import json
import os
from pathlib import Path

from trocar import services
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.private_directory import open_text

#: The built page, from services/visualization/web.
DIST = Path(services.__file__).parent / "visualization" / "web" / "dist"


def page_file(transport: Transport) -> Path:
    """Return the path of the file; the folder is private to the user."""
    return endpoints.run_directory(transport) / "page.json"


def write_page_file(path: Path, address: str, token: str, fingerprint: str = "") -> None:
    """Write the file, readable by this user only."""
    with open_text(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC) as file:
        json.dump({"address": address, "token": token, "fingerprint": fingerprint}, file)
