"""Where a vehicle is, by its own pictures."""
