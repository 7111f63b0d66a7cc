"""Published problems and their reference values."""
