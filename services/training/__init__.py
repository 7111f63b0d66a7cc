"""Attempts at a procedure, their goals and limits, and the process that follows them."""
