"""Recordings judged: a file to the assessments of its attempts. The same file gives the same bytes."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from trocar.review.attempts.assess import TOPICS, Terms, assess
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.experts import load_band
from trocar.services.recordings.reader import read_arrays, read_messages
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.scenario import Goal, Scenario, load_scenario
from trocar.services.training.score import Band, ScoreRules
from trocar.services.training.site import Site, read_site

#: What is done where a recording names no scenario: there is no depth that ends it, but the limits hold.
PRACTICE = Scenario(name="practice", title="Practice without a goal", scene="", goal=Goal(depth_m=0.01))


def assess_file(
    path: Path, rules: ScoreRules, scenario: str | None = None, experts: Path | None = None
) -> list[Assessment]:
    """Return the attempts in a recording, in the order in which they were made.

    Raises RecordingError or ConfigError: one sentence, if recording, scenario or experts cannot be used.

    Args:
        scenario: A file, or a name in configs/scenarios, that all attempts are judged by; None: the one that each
            names.
        experts: Reference attempts, as `trocar attempts export` writes them.
    """
    named = load_scenario(scenario) if scenario is not None else None
    site = _site(path)

    @cache
    def scenario_of(name: str) -> Scenario:
        return named or (load_scenario(name) if name else PRACTICE)

    @cache
    def band_of(name: str) -> Band:
        return load_band(experts, name) if experts is not None else {}

    terms = Terms(scenario_of=scenario_of, rules=rules, band_of=band_of, site=site)
    source = os.fsencode(path.name).decode("utf-8", "backslashreplace")  # what is kept and shown is text
    return list(assess(read_messages(path, TOPICS), terms, source))


def _site(path: Path) -> Site | None:
    """Return where the mouth is, None of a recording without its duct."""
    duct = read_arrays(path, "duct.npz")
    if duct is None:
        return None
    try:
        return read_site(duct)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
