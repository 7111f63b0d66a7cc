"""The force law that a hand feels, and what bounds it: pure functions, without clock, bus or device."""
