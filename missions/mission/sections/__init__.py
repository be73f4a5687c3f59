"""The sections of a mission file."""
