"""``trocar replay``: a recorded simulation run again, and compared with what was recorded."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import typer

from services.cli.rerun import compare
from services.recordings.inputs import read_inputs


def run_check(path: Path, as_json: bool) -> None:
    """Run the inputs of a recording again and say whether the states are those recorded; exit code 1 if not.

    Raises
    ------
    RecordingError
        if it cannot be run again, with the reason.
    """
    inputs = read_inputs(path)
    inputs.check_mechanics()
    found = compare(inputs)
    if as_json:
        print(json.dumps({"file": str(path), **asdict(found), "ended": inputs.ended}))
    else:
        until = f", up to where {inputs.ended}" if inputs.ended else ""
        print(f"{path}: {found.ticks} ticks run again{until}; {found.alike} of {found.compared} kept states are alike")
        if found.first_difference:
            print(f"the first difference: {found.first_difference}")
            print(f"at the end the catheter is {1e6 * found.apart_m:.3g} um from where it was")
        if inputs.machine_differs:
            print("it was recorded on another kind of machine or with other libraries: the last bits may differ")
    if found.first_difference or not found.compared:
        raise typer.Exit(1)
