"""Virtual hands for input devices without force: mouse, keyboard, gamepad and SpaceMouse."""
