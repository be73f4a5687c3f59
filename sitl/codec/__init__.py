"""Bytes of MAVLink frames, packed fast."""
