"""Orders to the gateway: the rig's time, restarts of the scene, safe stop and arming."""
