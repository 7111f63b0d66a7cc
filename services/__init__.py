"""Trocar's processes and libraries: a folder with a ``__main__.py`` is a process, one without is a library."""
