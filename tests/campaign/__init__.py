"""Random missions with everything that can go wrong: `python -m tests.campaign`."""
