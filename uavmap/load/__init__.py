"""A mission file with its references becomes a Mission."""
