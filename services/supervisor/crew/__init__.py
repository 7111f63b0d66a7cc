"""The processes of the rig: how they are started, heard, watched, restarted and ended."""
