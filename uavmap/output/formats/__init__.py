"""One encoder a format."""
