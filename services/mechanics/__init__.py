"""Pure numerics of the rig: shell FEM, modal reduction, catheter, contact, effects. No bus, no clock, no files."""
