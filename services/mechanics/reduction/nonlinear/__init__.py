"""The nonlinear membrane: its energy, and the cubic force in modal coordinates."""
