"""Choice of the next order of a vehicle: search, sweep, stepwise, survey, leapfrog."""
