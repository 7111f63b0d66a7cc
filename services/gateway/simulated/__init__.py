"""Simulated arms and emulated drives: devices that this machine computes."""
