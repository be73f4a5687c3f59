"""Loading: a mission file, with all files that it names, becomes a Mission."""
