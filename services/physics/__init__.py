"""Process: the duct and the catheter, one step of 1 ms per tick of the rig's clock."""
