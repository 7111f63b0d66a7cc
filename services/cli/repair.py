"""``trocar repair``: recordings whose recorder was killed, made whole for readers that seek by index."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from trocar.services.recordings.repair import repair


def run_repair(files: Iterable[Path], as_json: bool) -> None:
    """Mend each file in place and say what was found.

    Raises RecordingError for the first that is no recording, is being written, or has holes.
    """
    for path in files:
        found = repair(path)
        if as_json:
            done = {"file": str(path), "mended": found is not None}
            print(json.dumps(done if found is None else done | {"frames": found.frames, "cut_bytes": found.cut_bytes}))
        elif found is None:
            print(f"{path}: is whole")
        else:
            print(f"{path}: indexed anew, {found.frames} frames; {found.cut_bytes} bytes of a torn end were cut off")
