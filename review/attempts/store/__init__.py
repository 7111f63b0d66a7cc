"""Attempts kept: SQLite by default, PostgreSQL by URL, the same code. Trainees are known by a pseudonym alone."""
