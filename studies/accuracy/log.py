"""What a run has found so far, in a folder: a run that was ended goes on there."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.files.atomic_file import atomic_file, complete_lines
from trocar.studies.accuracy.study import Cost, Draw, Error, Reference
from trocar.studies.result_folder import read_as_ours


class StudyLog:
    """Results in a folder: one line of JSON each, references as arrays.

    Raises ValueError if the folder holds results of another size, seed or code.

    Attributes:
        errors: dict. By study and setting, then by quantity.
        costs: dict. By study, then by setting.
        timed: set. Studies and groups of settings of which the costs are known.
    """

    def __init__(self, folder: Path, draw: Draw, code: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        head = {"size": draw.size.value, "seed": draw.seed, "code": code}
        head_file = folder / "order.json"
        with read_as_ours(folder):
            if head_file.exists() and json.loads(head_file.read_text()) != head:
                raise ValueError(f"{folder} holds the results of {json.loads(head_file.read_text())}, not of {head}")
        with atomic_file(head_file) as half:
            half.write_text(json.dumps(head))
        self._folder, self._file = folder, folder / "results.jsonl"
        self.errors: dict[tuple[str, str], dict[str, Error]] = {}
        self.costs: dict[str, dict[str, Cost]] = {}
        self.timed: set[tuple[str, str]] = set()
        with read_as_ours(folder):
            for line in complete_lines(self._file):
                self._take(json.loads(line))

    def _take(self, entry: dict[str, Any]) -> None:
        if "errors" in entry:
            errors = {name: Error(**each) for name, each in entry["errors"].items()}
            self.errors[entry["study"], entry["setting"]] = errors
        else:
            self._add_costs(entry["study"], {name: Cost(**each) for name, each in entry["costs"].items()})
            self.timed.add((entry["study"], entry["group"]))

    def _add_costs(self, study: str, costs: dict[str, Cost]) -> None:
        """Take the costs of a group; what stood beside several groups is told as it was beside the slowest."""
        known = self.costs.setdefault(study, {})
        known |= {
            name: max(known.get(name, cost), cost, key=lambda each: each.median_us) for name, cost in costs.items()
        }

    def keep_errors(self, study: str, setting: str, errors: dict[str, Error]) -> None:
        """Write the errors of a setting down."""
        told = {name: asdict(each) for name, each in errors.items()}
        self._keep({"study": study, "setting": setting, "errors": told})

    def keep_costs(self, study: str, group: str, costs: dict[str, Cost]) -> None:
        """Write the costs of a group of a study's settings down."""
        self._keep({"study": study, "group": group, "costs": {name: asdict(each) for name, each in costs.items()}})

    def _keep(self, entry: dict[str, Any]) -> None:
        self._take(entry)
        with self._file.open("a") as file:
            file.write(json.dumps(entry) + "\n")

    def reference(self, study: str) -> Reference | None:
        """Return the reference of a study, if it is there."""
        file = self._folder / f"reference-{study}.npz"
        if not file.exists():
            return None
        with np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)

    def keep_reference(self, study: str, reference: Reference) -> None:
        """Write the reference of a study down: whole or not at all."""
        with atomic_file(self._folder / f"reference-{study}.npz") as half:
            np.savez(half, allow_pickle=False, **dict(reference))
