"""The journal of a mission: the log of its events, and how a damaged one is recovered."""
