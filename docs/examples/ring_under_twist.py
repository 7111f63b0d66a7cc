"""A catheter bent into a ring, its ends joined with some turns of twist: how many until it leaves its plane?

python docs/examples/ring_under_twist.py
"""

import numpy as np

from trocar.services.mechanics.rod import ImplicitIntegrator, RoundTube, Supports, initial_frame, rod_along, roll

tube = RoundTube(outer_diameter_m=1.67e-3, inner_diameter_m=1.0e-3, youngs_modulus_pa=100e6, density_kg_m3=1100)
catheter = tube.rod(n_segments=100, length_m=0.1, twist=True, internal_damping_s=1e-4, viscous_drag_n_s_m2=0.05)
joint = Supports(held=(0, -1), start_direction=(0, 1, 0), end_direction=(0, 1, 0))
angle = np.linspace(0, 2 * np.pi, 101)
circle = 0.5e-3 / np.sin(np.pi / 100) * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
# Michell 1889
michell_rad = 2 * np.pi * np.sqrt(3) * catheter.bending_stiffness_n_m2 / catheter.torsional_stiffness_n_m2

height_m = {}
for share in (0.98, 1.02):
    integrator, state = ImplicitIntegrator(catheter, joint), rod_along(catheter, circle)
    state.position_m[:, 2] = 1e-7 * (1 - np.cos(2 * angle))
    state.frame = initial_frame(state.position_m, walls=joint.wall_directions())
    state.frame.end_is_held = True
    height_m[share] = 0.0
    # Nothing keeps this ring from passing through itself: then two turns are gone, and it lies flat again.
    for step in range(2500):
        if step < 1500:  # by both ends: material that rolls in a bend drags it along, and the ring would swing aside
            roll(state.frame, 0, -0.5 * share * michell_rad / 1500)
            roll(state.frame, -1, 0.5 * share * michell_rad / 1500)
        integrator.predict(state, np.zeros((101, 3)), dt_s=1e-3)
        height_m[share] = max(height_m[share], np.ptp(state.position_m[:, 2]))
    turns = share * michell_rad / (2 * np.pi)
    print(f"{turns:.2f} turns, {share} of Michell's: the ring rises {1e3 * height_m[share]:.2f} mm out of its plane")
