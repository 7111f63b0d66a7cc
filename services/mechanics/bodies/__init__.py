"""What moves and touches: duct, catheter and forceps, with the duct's wall and its mouth."""
