"""Lanes of the search: where they lie, who flies which, in which order."""
