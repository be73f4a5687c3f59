"""Links to vehicles: URLs, transports, and the MAVLink session on top of them."""
