"""Frames of one aircraft: requested, received and judged."""
