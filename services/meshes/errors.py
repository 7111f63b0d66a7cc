"""What a mesh file that cannot be used is refused with."""


class MeshError(ValueError):
    """A surface that cannot become a shell model; the sentence names the file or place and the reason."""

    is_told = True
    """Raised in a reader, the sentence goes to who asked as it is; see `trocar.services.foreign_files`."""
