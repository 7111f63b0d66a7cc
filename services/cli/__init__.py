"""The `trocar` command."""
