"""What a process needs and nothing of physics: bus, deadline loop, real-time set-up, configuration, health."""
