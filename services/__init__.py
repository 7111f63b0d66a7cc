"""Trocar's processes and libraries: a folder with a ``__main__.py`` is a process, one without is a library."""

from services import bytecode, kernel_cache, start_up

start_up.begin()
bytecode.keep()
kernel_cache.choose()
