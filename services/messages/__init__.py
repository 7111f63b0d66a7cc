"""What a command tells a person: exit codes, and parts of sentences."""
