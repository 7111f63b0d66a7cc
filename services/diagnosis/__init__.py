"""Diagnosis of a running rig from outside: late ticks, the rig's threads by the kernel, and the machine alone."""
