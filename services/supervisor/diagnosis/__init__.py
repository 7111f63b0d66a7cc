"""Observers of a running rig: data beside the processes' own reports."""
