"""The school at a rig: who trains, what was done and judged, what comes next; and an instructor's desk."""
