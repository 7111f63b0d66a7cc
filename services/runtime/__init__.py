"""Infrastructure of every process, without physics: bus, deadline loop, real-time set-up, configuration, health."""
