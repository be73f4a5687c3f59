"""A flight under way: service, vehicles, guardians, manoeuvres, imaging, people on the ground."""
