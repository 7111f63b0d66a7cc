"""Attempts that were judged, kept in the database; what the database refuses does not lose what was judged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from trocar.review.attempts.assessment import Assessment
from trocar.services.runtime.errors import UserError


@dataclass(slots=True)
class Kept:
    """What has become of attempts that were to be kept.

    Attributes:
        numbers: Their numbers in the database.
        moved: Whose an attempt was until now, and whose it is, of those that another trainee had.
        refused: Why the rest is not kept; None where all are.
    """

    numbers: list[int] = field(default_factory=list)
    moved: dict[int, tuple[str, str]] = field(default_factory=dict)
    refused: UserError | None = None


def keep(found: Iterable[Assessment], trainee: str, database: str | None, file: Path) -> Kept:
    """Keep the attempts in a recording as a trainee's."""
    from trocar.review.attempts.store.attempts import Store, StoreError

    kept = Kept()
    try:
        with Store(database) as store:
            for each in found:
                before, number = store.kept_of(each), store.add(each, trainee, file)
                kept.numbers.append(number)
                if before is not None and before != trainee:
                    kept.moved[number] = before, trainee
    except StoreError as error:
        kept.refused = StoreError(f"not kept: {error}")
    return kept
