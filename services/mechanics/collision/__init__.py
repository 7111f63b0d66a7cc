"""Collision detection: the catheter and both forceps against the deforming duct and against each other."""

from services.mechanics.collision.catheter import CatheterContactDetector
from services.mechanics.collision.self_contact import SelfContactDetector
from services.mechanics.collision.surface import DuctSurface
from services.mechanics.collision.tools import ToolContactDetector

__all__ = ["CatheterContactDetector", "DuctSurface", "SelfContactDetector", "ToolContactDetector"]
