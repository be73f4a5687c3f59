"""One scene, drawn as SVG, as a raster and as a film."""
