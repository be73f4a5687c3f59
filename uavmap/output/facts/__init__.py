"""The facts of a mission that every format and drawing shows."""
