"""Geometry on the ground: UTM geodesy, the grid of cells, the geofence, the search lanes."""
