"""An exploration as an animation, and as a picture of its tree."""
