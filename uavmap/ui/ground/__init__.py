"""The ground beneath the maps of a page: one class for each format of a file."""
