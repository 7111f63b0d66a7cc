"""CAN buses, ODrives on them, and adapters."""
