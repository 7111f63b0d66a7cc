"""Contact between tools, catheter and duct: rows from candidate pairs, and their solve in contact space."""
