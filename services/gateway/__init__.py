"""Process: the devices, and the 1 kHz servo that the hand feels."""
