"""Lanes of the search: where they lie, which vehicle flies them, in which order."""
