"""Attempts at a procedure: what an attempt is, its goal and limits, and the process that follows it."""
