"""The laws of the wall beyond its linear modes, as terms of one potential, and their one implicit step."""
