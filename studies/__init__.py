"""Studies: published references, accuracy against time, what an effect costs. Library, no process."""
