"""Planning that a flight, a mission's check and a study share."""
