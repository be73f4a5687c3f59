"""What a flight keeps on disk while it lasts: event log, flight plan, telemetry log, frames."""
