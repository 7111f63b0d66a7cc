"""Process: collision detection of the tools, and a local force model for the servo, every millisecond."""
