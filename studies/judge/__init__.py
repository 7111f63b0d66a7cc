"""A judge from outside: how deep bodies are in each other, by brute force over what is drawn.

It reads positions alone: no solver's row, no collision detection, no memory of sides. `closest` has the distances,
`overlaps` the bodies of a simulation.
"""
