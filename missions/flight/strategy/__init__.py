"""What a vehicle does next: search, sweep, stepwise, survey, leapfrog."""
