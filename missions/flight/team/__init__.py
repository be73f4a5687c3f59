"""A vehicle alone, or as a member of a fleet."""
