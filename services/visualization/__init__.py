"""Process: pictures composed from the bus, streamed to browsers or drawn in a window."""
