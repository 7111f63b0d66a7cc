"""Library: message formats of recordings, and reading recordings back as bodies of the bus."""
