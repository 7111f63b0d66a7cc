"""Pure numerics of the rig: shell FEM, modal reduction, catheter, contact, effects. No bus, no clock, no files.

From the bottom up; each imports only from those before it, which a contract in pyproject.toml checks:
`arrays` array types, `compiled` how kernels are compiled, `surface` meshes, `fem` the shell and `rod` the catheter as
models of their own, `reduction` from the shell to modes, `scene` what a person asks for, `collision` candidate pairs,
`bodies` what moves, `contact` the forces between them, `effects` what a scene may name, `simulation` the step of it
all, `scenarios` scripted hands.
"""
