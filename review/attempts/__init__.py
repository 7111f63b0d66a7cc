"""Attempts in recordings: judged, measured, scored, reported and kept."""
