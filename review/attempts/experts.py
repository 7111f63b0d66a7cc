"""Reference attempts: the band that they make, and who is within it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from trocar.services.runtime.errors import ConfigError
from trocar.services.training.errors import ErrorEvent
from trocar.services.training.score import Band, Range, ScoreRules

ERRORS_NAME = "errors"


def band_of(attempts: Iterable[Mapping[str, float]]) -> dict[str, Range]:
    """Return mean and deviation of every metric that all reference attempts have; of a single one no deviation."""
    known = list(attempts)
    if not known:
        return {}
    names = sorted(set.intersection(*(set(each) for each in known)))
    values = {name: np.array([each[name] for each in known]) for name in names}
    freedom = min(1, len(known) - 1)
    return {name: Range(float(each.mean()), float(each.std(ddof=freedom))) for name, each in values.items()}


def load_band(path: Path, scenario: str) -> dict[str, Range]:
    """Return the band of the successes at a scenario in a file that `trocar attempts export` has written.

    Raises ConfigError naming the file, if it cannot be read, or holds no such attempt.
    """
    try:
        attempts = json.loads(path.read_text(encoding="utf-8"))["attempts"]
        chosen = [
            each["metrics"] for each in attempts
            if each["scenario"] == scenario and each["outcome"] == "success" and each["counts"]
        ]  # fmt: skip
        band = band_of([{str(name): float(value) for name, value in metrics.items()} for metrics in chosen])
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ConfigError(f"{path}: is no file of attempts, as `trocar attempts export` writes it") from None
    if not band:
        raise ConfigError(f"{path}: holds no attempt at {scenario!r} that succeeded and counts")
    return band


def is_proficient(metrics: Mapping[str, float], band: Band, rules: ScoreRules) -> bool | None:
    """Return whether time and errors are within the experts' mean and some deviations; None without experts."""
    if not {"time_s", ERRORS_NAME} <= band.keys():
        return None
    reached = (band[name].mean + rules.expert_deviations * band[name].deviation for name in ("time_s", ERRORS_NAME))
    return all(metrics[name] <= most for name, most in zip(("time_s", ERRORS_NAME), reached, strict=True))


def counts_of(errors: Iterable[ErrorEvent]) -> dict[str, float]:
    """Return the numbers of errors as metrics: all, and those of each severity that occurred."""
    known = list(errors)
    of_severity = Counter(event.severity for event in known)
    return {ERRORS_NAME: float(len(known))} | {f"{ERRORS_NAME}.{each}": float(n) for each, n in of_severity.items()}
