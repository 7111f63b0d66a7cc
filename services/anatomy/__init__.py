"""From a segmentation or a surface of a patient to a scene that runs. Library, no process."""
