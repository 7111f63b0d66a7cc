"""The wall's softening in a step: a force on the modes that follows from a potential of their displacement."""
