"""Bodies of a simulation: duct, catheter and forceps, with the duct's wall and its lumen."""
