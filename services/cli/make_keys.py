"""``trocar keys``: the key pair that the processes of a rig on several hosts know each other by."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from trocar.services.runtime import keys


def run_keys(directory: Path, as_json: bool) -> None:
    """Make the keys and say what to do with them."""
    file = keys.make(directory)
    if as_json:
        print(json.dumps({"secret": str(file)}))
        return
    print(
        f"made {file}: copy it to every host of the rig, keep it as secret as the rig is, and set transport.keys",
        file=sys.stderr,
    )
