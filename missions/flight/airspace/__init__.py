"""Which air is reserved, by whom and until when."""
