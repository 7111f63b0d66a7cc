"""A number with its range and its source: of tissue, of an anatomy, or of a product."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SourcedValue:
    """A value in SI units with its range and source; ``assumed`` marks one without a measurement or a norm.

    Raises ValueError if the value is outside its range.
    """

    __pydantic_config__ = {"extra": "forbid", "strict": True, "allow_inf_nan": False}  # noqa: RUF012 - pydantic's way

    value: float
    low: float
    high: float
    source: str
    assumed: bool = False

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise ValueError(f"{self.value} is outside its own range {self.low} to {self.high}")


def assumed_value(value: float, low: float, high: float, source: str) -> SourcedValue:
    """Return a value that is an assumption."""
    return SourcedValue(value, low, high, source, assumed=True)
