"""How long an exploration must take at least, and may take at most."""
