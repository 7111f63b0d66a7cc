"""Your own shells: cases in files, solved, shown and written."""
