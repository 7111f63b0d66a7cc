"""A 5 Fr catheter, clamped level at one end, let go: how far does the tip drop, and how long does it swing?

python docs/examples/hanging_catheter.py
"""

import numpy as np

from trocar.services.mechanics.rod import ImplicitIntegrator, RoundTube, clamped, straight_rod

tube = RoundTube(outer_diameter_m=1.67e-3, inner_diameter_m=1.0e-3, youngs_modulus_pa=100e6, density_kg_m3=1100)
catheter = tube.rod(n_segments=50, length_m=0.1, internal_damping_s=2e-3)
integrator = ImplicitIntegrator(catheter, clamped(direction=(1, 0, 0)))
state = straight_rod(catheter, start_m=(0, 0, 0), direction=(1, 0, 0))
weight_n = catheter.particle_mass_kg()[:, None] * np.array([0.0, 0.0, -9.81])

tip_m = []
for _ in range(3000):
    integrator.predict(state, weight_n, dt_s=1e-3)
    tip_m.append(state.position_m[-1, 2])

print(f"the tip drops {-1e3 * tip_m[-1]:.2f} mm, after swinging through {-1e3 * min(tip_m):.2f} mm")
