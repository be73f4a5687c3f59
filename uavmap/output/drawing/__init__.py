"""The drawing of maps: one scene as SVG, as a raster and as a PDF."""
