"""Exploration without stopping: what is worth a frame, paths for a team, and runs of them."""
