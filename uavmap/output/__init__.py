"""The results of a mission: one writer for each file format, all from the same `MapData`."""
