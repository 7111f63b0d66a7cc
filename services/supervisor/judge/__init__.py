"""Judgement of a running rig by its reports: contracts, enforcement, quality and the rig's state. Pure functions."""
