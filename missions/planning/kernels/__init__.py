"""Loops over arrays that run millions of times, compiled if numba is installed.

Import these modules where they are first needed, not at the top of a file: numba takes a second.
"""
