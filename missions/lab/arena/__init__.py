"""Strategies without flight: perfect robots on a ROI, lower bounds, certificates."""
