"""One flight from start to end: preflight, service, vehicles, operator, and the door to `sitl`."""
