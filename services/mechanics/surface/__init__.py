"""The duct's mid-surface: triangle meshes, and the tube made from a few numbers."""
