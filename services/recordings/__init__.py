"""Library: what the messages of a recording look like, and files of them read back as the bodies of the bus."""
