"""Scripts to read and to change: ``python -m trocar.examples.poke`` runs one, ``# %%`` parts it into cells."""
