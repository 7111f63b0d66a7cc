"""One file per driver, found by its name in the rig file; a new device only needs a file here."""
