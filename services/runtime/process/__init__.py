"""Opening a process of the rig, and its reports on itself."""
