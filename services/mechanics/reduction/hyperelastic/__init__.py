"""A wall whose material stiffens as it is stretched: Fung's exponential membrane beyond its linear part."""
