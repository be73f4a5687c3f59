"""The commands `simulate` and `study`."""
