"""The studies, one module each: a new one is found by its name, see docs/how-to/recipes.md."""
