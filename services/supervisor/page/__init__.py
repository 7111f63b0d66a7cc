"""The page's process and its data: dashboard, metrics, and the commands of people."""
