"""Maps beneath the drawings of a page: one class for each file format."""
