"""Settings of a rig at its page: rig, scene and device files checked and kept; its logs, recordings and devices."""
