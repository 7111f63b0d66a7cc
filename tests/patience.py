"""How long a test waits for what others are to do: another process, a thread, a browser.

Only where it never comes does a test wait for so long. What a quiet machine does in a second a busy one may do in a
minute, and a deadline that is missed then says nothing about what is tested.
"""

#: Half of what a test may take (`timeout` in pyproject.toml), so that what did not come is told by its name.
PATIENCE_S = 300.0
