"""Beliefs about the ground and decisions on where to fly next: pure, no clock, socket or disk."""
