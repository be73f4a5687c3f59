"""What a mission leaves behind: one writer a file format, all fed with the same `MapData`."""
