"""Softening wall in a step: a force on the modes with a potential of their displacement."""
