"""How each driver runs without its device: a file of the driver's name with a function ``bench`` (see `bench`)."""
