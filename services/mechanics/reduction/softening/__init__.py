"""A wall that gives way: what a shell's large displacements add to the linear response to forces on its wall."""
