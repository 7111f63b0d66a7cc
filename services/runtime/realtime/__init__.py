"""Real-time set-up of a process: scheduling class, memory, and what the machine granted."""
