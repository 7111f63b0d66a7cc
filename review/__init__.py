"""What people do with what a rig recorded: judge attempts, report, keep them, export and film, watch a class."""
