"""What is believed about the ground and where to look next: pure, no clock, socket or disk."""
