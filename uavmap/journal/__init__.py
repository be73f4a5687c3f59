"""The files of a flight in progress: event log, flight plan, telemetry log, frames."""
