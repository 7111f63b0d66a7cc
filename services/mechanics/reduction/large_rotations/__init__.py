"""Large rotations of a tube: cross-sections that turn as rigid frames, and the modes within them."""
