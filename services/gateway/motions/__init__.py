"""Motions that are prepared: scripts, scenarios of the mechanics, and hands that fit the rig's scene."""
