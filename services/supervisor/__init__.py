"""Process: starts or attaches to the others, judges deadlines, enforces them, serves dashboard and metrics."""
