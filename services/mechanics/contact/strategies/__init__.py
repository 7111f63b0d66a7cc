"""The table of solve strategies: how contact forces are found. A scene names one, and it is looked up once.

A new strategy is one module in this folder, one row here, and its name in `ContactSettings.model`.
"""

from __future__ import annotations

from services.mechanics.contact.strategies.implicit import ImplicitStrategy
from services.mechanics.contact.strategies.penalty import PenaltyStrategy
from services.mechanics.contact.strategies.strategy import ContactStrategy

STRATEGIES: dict[str, type[ContactStrategy]] = {
    "implicit": ImplicitStrategy,
    "penalty": PenaltyStrategy,
}

__all__ = ["STRATEGIES", "ContactStrategy"]
