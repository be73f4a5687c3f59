"""Hostile inputs for every door of the program: `python -m tests.fuzz --help`."""
