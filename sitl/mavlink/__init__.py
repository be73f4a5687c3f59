"""Messages in, messages out: interpreting, telemetry, transfers, signing, packing."""
