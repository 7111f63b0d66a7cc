"""Common parts of the rig's web servers: certificate, headers, host."""
