"""Where things are: UTM geodesy, the grid of cells, the geofence, the search lanes."""
