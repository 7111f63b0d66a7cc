"""The deadline loop, and what loops use in a tick."""
