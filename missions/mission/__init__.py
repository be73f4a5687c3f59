"""The mission file: its schema, the checks of the whole, and messages about faults."""
