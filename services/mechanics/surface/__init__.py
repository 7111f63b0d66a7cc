"""The duct's mid-surface: triangle meshes, and the parametric tube."""
