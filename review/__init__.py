"""Work on what a rig recorded: people judge attempts, report on them, keep, export and film them, and watch a class."""
