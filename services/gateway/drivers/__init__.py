"""One file a driver, found by its name in the rig file: a file here is all that a new device needs."""
