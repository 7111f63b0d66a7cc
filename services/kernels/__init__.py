"""Compiled kernels: where they are kept, what they were compiled from, and for which processor."""
