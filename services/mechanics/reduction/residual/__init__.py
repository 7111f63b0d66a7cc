"""The residual compliance: what the modes left out answer, in blocks, patches, turned, and as a field."""
