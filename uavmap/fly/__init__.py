"""A flight under way: service, vehicles, manoeuvres, imaging, people on the ground."""
