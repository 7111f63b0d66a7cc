"""The page: JavaScript sources, and the command that builds them."""
