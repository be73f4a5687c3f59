"""Poses of recorded pictures, refined by their overlaps."""
