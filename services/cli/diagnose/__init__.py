"""The verbs of `trocar diagnose`: what a running rig does, seen from outside."""
