"""Files that are written whole, and places that nobody else may write."""
