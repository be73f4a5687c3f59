"""One aircraft: its orders, manoeuvres, streams, guardian and cameras."""
