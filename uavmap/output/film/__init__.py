"""An exploration as an animation, and as a picture of its tree."""

from uavmap.output.film.film import Film
from uavmap.output.film.film_writers import DRAWINGS, FILMS, check_path, write_film
from uavmap.output.film.flight_film import film_of_flight, title_of
from uavmap.output.film.tree_picture import draw_tree

__all__ = [
    "DRAWINGS",
    "FILMS",
    "Film",
    "check_path",
    "draw_tree",
    "film_of_flight",
    "title_of",
    "write_film",
]
