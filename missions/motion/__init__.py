"""How a vehicle moves along a planned path: exact functions of mission time."""
