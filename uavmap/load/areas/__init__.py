"""Areas that were drawn elsewhere: reading them, and laying a mission out over them."""
