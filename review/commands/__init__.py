"""Verbs of the `trocar` command that review runs: what each does, a module each."""
