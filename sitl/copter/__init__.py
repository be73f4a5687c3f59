"""What every simulated autopilot has: phases of flight, missions, geofence, parameters."""
