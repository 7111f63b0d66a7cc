"""Process: collision detection of the tools, and a local model of force for the servo, every millisecond."""
