"""The instruments of the rig: each one's arm, handle and servo, and the contact models that reach it."""
