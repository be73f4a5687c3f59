"""Work without aircraft on recorded pictures: replay, registration, training of detectors."""
