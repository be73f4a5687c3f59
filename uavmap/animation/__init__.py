"""An exploration as an animation, and as a picture of its tree."""

from uavmap.animation.film import Film
from uavmap.animation.of_flight import film_of_flight, title_of
from uavmap.animation.of_nonstop import film_of_nonstop
from uavmap.animation.of_run import film_of_run
from uavmap.animation.tree_picture import draw_tree
from uavmap.animation.writers import DRAWINGS, FILMS, check_path, write_film

__all__ = [
    "DRAWINGS",
    "FILMS",
    "Film",
    "check_path",
    "draw_tree",
    "film_of_flight",
    "film_of_nonstop",
    "film_of_run",
    "title_of",
    "write_film",
]
