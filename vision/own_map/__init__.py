"""The position of a vehicle by its own pictures."""
