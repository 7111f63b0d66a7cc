"""The page's place: its files, its socket, and the file with its address and token. Needs no web package."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import services
from services.runtime import endpoints
from services.runtime.errors import BusError
from services.runtime.private_directory import open_text
from services.runtime.rig import Transport, WebSettings

#: The built page: made of services/visualization/web, whose process does not serve it.
DIST = Path(services.__file__).parent / "visualization" / "web" / "dist"


def page_file(transport: Transport) -> Path:
    """Return the path of the file; the folder is private to the user."""
    return endpoints.run_directory(transport) / "page.json"


def write_page_file(path: Path, address: str, token: str) -> None:
    """Write the file, readable by this user only."""
    with open_text(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC) as file:
        json.dump({"address": address, "token": token}, file)


def listen(settings: WebSettings) -> socket.socket:
    """Return the bound socket of the page.

    Raises
    ------
    BusError
        if the address cannot be had.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((settings.host, settings.port))
        made.listen(64)
    except OSError as error:
        made.close()
        where = f"{settings.host}:{settings.port}"
        raise BusError(
            f"the web page cannot have {where}: {(error.strerror or str(error)).lower()}; "
            f"choose another with --set supervisor.web.port=N"
        ) from None
    return made
