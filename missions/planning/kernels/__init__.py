"""Loops that are run millions of times, on arrays, compiled where numba is installed.

Import these modules where they are first needed, not at the top of a file: numba takes a second.
"""
