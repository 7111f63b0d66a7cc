"""Process: starts or attaches to the others, judges and enforces deadlines, serves dashboard and metrics."""
