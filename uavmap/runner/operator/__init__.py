"""The operator of a flight: keys, interrupts, progress."""
