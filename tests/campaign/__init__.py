"""Random missions with random troubles: `python -m tests.campaign`."""
