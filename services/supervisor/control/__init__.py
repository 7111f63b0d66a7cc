"""The supervisor itself: it judges the state of the rig, acts on faults, and carries out commands."""
