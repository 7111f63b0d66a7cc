"""The start of a program: what is set before numpy is imported, how far it is, and how it is interrupted."""
