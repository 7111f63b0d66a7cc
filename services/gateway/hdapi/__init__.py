"""OpenHaptics HDAPI, the vendor's library for Phantom and Touch arms, as the gateway uses it.

`library` binds it, `servo_callback` runs in its 1 kHz thread, `handover` exchanges numbers between that thread and the
gateway's loop without waiting, `session` manages the scheduler. Nothing is loaded at import.
"""
