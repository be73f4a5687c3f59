"""Flights of real autopilots, ArduCopter and PX4, each in its own simulation: `make test-real`."""
