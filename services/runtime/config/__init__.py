"""Configuration: the rig file, its bounds, and what a scene requires of a rig."""
