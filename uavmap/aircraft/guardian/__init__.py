"""The guardian of one aircraft, and what it measures."""
