"""The common part of simulated autopilots: phases of flight, missions, geofence, parameters."""
