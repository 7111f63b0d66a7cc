"""Trials by chance, a line of JSON each in a file of its proof: what was tried is kept, so a run can go on."""

from __future__ import annotations

import json
import secrets
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.files.atomic_file import complete_lines


@dataclass(frozen=True, slots=True)
class Found:
    """What one trial came to.

    Attributes:
        kind: What was drawn, by which failures are counted apart.
        tried: Cases in the trial.
        failed: Cases of them that failed.
        why: A sentence for each way of failing.
        figures: What was measured, by name with its unit.
    """

    kind: str = ""
    tried: int = 1
    failed: int = 0
    why: tuple[str, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)


Try = Callable[[np.random.Generator], Found]


@dataclass(frozen=True, slots=True)
class Proof:
    """So many cases by chance, of which none may fail.

    Attributes:
        name: Of the file of its lines.
        cases: What a case is.
        asked: How many of them.
        holds: What is so in every case.
        begin: Prepares what all trials need and yields how one is made; entered anew after a failure.
        at_once: Cases must all be of one beginning, as what is asked for is that it runs on.
        hindered: Returns why it cannot be tried here, empty where it can.
        chance_of: What trials are called where the cases of one are not independent, so a rate is one of trials.
    """

    name: str
    cases: str
    asked: int
    holds: str
    begin: Callable[[], AbstractContextManager[Try]]
    at_once: bool = False
    hindered: Callable[[], str] = str
    chance_of: str = ""


@dataclass(frozen=True, slots=True)
class Line:
    """A trial as it is kept: by whose code, from which seed, in which beginning, and what it came to."""

    commit: str
    seed: int
    beginning: int
    found: Found


class Ledger:
    """The lines of all proofs, in a folder.

    Args:
        folder: Made when the first line is written.
        commit: Of the code that is tried.
    """

    def __init__(self, folder: Path, commit: str) -> None:
        self._folder, self._commit = folder, commit

    def lines(self, proof: Proof) -> list[Line]:
        """Return what was kept; a last line that was cut when its writer was killed is none."""
        return [_line(json.loads(row)) for row in complete_lines(self._file(proof))]

    def add(self, proof: Proof, seed: int, beginning: int, found: Found) -> None:
        """Keep a trial."""
        self._folder.mkdir(parents=True, exist_ok=True)
        complete_lines(self._file(proof))
        with self._file(proof).open("a", encoding="utf-8") as out:
            out.write(json.dumps(asdict(Line(self._commit, seed, beginning, found))) + "\n")

    def forget(self, proof: Proof) -> None:
        """Drop what was kept of a proof."""
        self._file(proof).unlink(missing_ok=True)

    def _file(self, proof: Proof) -> Path:
        return self._folder / f"{proof.name}.jsonl"


def _line(row: dict[str, Any]) -> Line:
    found = Found(**{**row["found"], "why": tuple(row["found"]["why"])})
    return Line(**{**row, "found": found})


def counted(proof: Proof, lines: list[Line]) -> list[Line]:
    """Return the lines that count: all, or those of the beginning that ran on for longest."""
    if not proof.at_once or not lines:
        return lines
    beginnings = [each.beginning for each in lines]
    longest = max(beginnings, key=beginnings.count)
    return [each for each in lines if each.beginning == longest]


def go_on(proof: Proof, ledger: Ledger, until_s: float, say: Callable[[str], object]) -> None:
    """Try what is left of a proof until a monotonic time; each trial has a seed of its own."""
    before = ledger.lines(proof)
    beginning = max((each.beginning for each in before), default=0)
    left = proof.asked - sum(each.found.tried for each in counted(proof, before))
    left = proof.asked if proof.at_once and left > 0 else left
    is_sound = True
    while left > 0 and time.monotonic() < until_s and (is_sound or not proof.at_once):
        beginning += 1
        with ExitStack() as stack:
            try_once, is_sound = _begun(proof, stack), True
            while is_sound and left > 0 and time.monotonic() < until_s:
                seed = secrets.randbits(32)
                found = tried(try_once, seed)
                ledger.add(proof, seed, beginning, found)
                left, is_sound = left - found.tried, not found.failed
                say(f"{proof.name}: {proof.asked - left:,} of {proof.asked:,} {proof.cases}, {found.failed} failed now")


def _begun(proof: Proof, stack: ExitStack) -> Try:
    """Prepare trials; where that fails, so does the first of them."""
    try:
        return stack.enter_context(proof.begin())
    except Exception:  # a rig that does not start is a failure as any other
        found = _broken()
        return lambda _chance: found


def tried(try_once: Try, seed: int) -> Found:
    """Make the trial of a seed; what it did not expect is its failure, not the end of the proof."""
    try:
        return try_once(np.random.default_rng(seed))
    except Exception:  # whatever a proof of robustness meets is what it looks for
        return _broken()


def _broken() -> Found:
    return Found(kind="broke", failed=1, why=(traceback.format_exc(limit=-3).strip(),))
