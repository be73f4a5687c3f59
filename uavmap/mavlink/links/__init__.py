"""URLs, transports, framing and signing: bytes between this program and an autopilot."""
