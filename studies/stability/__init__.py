"""Hard cases and their criteria: what must not blow up, not stay wrong, and not lie quietly.

A *family* is one file in `families` and one row in its table; it lists *cases*. A case runs and returns *figures*, one
number for each criterion that applies to it. The criteria are data, written down in `criteria` before anything runs.
"""
