"""The verbs of the `trocar` command that judge: study, stability, haptics, tune, fem, effects."""
