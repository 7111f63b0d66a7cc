"""Meshes from and to files: load, check, repair or refuse, remesh; VTU output. Library, no process."""
