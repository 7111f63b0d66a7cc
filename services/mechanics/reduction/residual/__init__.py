"""Residual compliance of a truncated modal basis: full, cyclic or in patches, rotated, and as a displacement field."""
