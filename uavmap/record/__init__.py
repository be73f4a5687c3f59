"""What a flight leaves on disk while it lasts: journal, flight plan, telemetry log."""
