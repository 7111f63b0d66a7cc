"""Where a running supervisor leaves its page's address and token, for commands of the same user."""

from __future__ import annotations

import json
import os
from pathlib import Path

from services.runtime import endpoints
from services.runtime.rig import Transport


def page_file(transport: Transport) -> Path:
    """Return the path of the file; the folder is private to the user."""
    return endpoints.run_directory(transport) / "page.json"


def leave(path: Path, address: str, token: str) -> None:
    """Write the file, readable by this user only."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
        json.dump({"address": address, "token": token}, file)
