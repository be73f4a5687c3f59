"""The other end of the wire: a simulated world, vehicles and cameras that speak MAVLink 2."""
