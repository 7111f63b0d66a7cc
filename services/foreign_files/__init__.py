"""Files that others made, read in another process with limits; what comes back is data. Library, no process."""

from trocar.services.foreign_files.client import Refusal, ask, ask_once
from trocar.services.foreign_files.limits import Limits, limits_of

__all__ = ["Limits", "Refusal", "ask", "ask_once", "limits_of"]
