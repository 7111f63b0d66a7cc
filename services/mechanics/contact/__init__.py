"""Contact between tools, catheter and duct: candidate pairs, and the solve in contact space."""

from services.mechanics.contact.pairs import ContactPairs

__all__ = ["ContactPairs"]
