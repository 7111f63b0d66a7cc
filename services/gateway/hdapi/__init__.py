"""OpenHaptics HDAPI, the vendor's library for Phantom and Touch arms, as the gateway uses it.

`library` binds it, `servo_callback` is what its 1 kHz thread runs, `handover` is how that thread and the gateway's loop
exchange numbers without waiting for each other, `session` is the life of the scheduler. Nothing is loaded at import.
"""
