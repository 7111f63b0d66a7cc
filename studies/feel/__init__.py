"""Proof of what is felt: the servo's own law against theory and against hands that try to get energy out of it."""
