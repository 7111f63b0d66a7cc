"""The nonlinear membrane: its energy, modal derivatives, and the cubic force in modal coordinates."""
