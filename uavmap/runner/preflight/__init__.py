"""The checks and settings before take-off."""
