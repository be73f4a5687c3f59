"""Registration: poses refined by the overlap of pictures. Pure: no file, clock or random number.

picture -> thumbnail -> extract -> View (features and tags) -> register -> Registration
"""

from vision.registration.ground_plane import Relief
from vision.registration.picture_features import WIDTH_PX, extract, thumbnail
from vision.registration.registering import Many, register
from vision.registration.views import (
    Agreement,
    Described,
    Features,
    Net,
    Prior,
    Refined,
    Registration,
    View,
)

__all__ = [
    "WIDTH_PX",
    "Agreement",
    "Described",
    "Features",
    "Many",
    "Net",
    "Prior",
    "Refined",
    "Registration",
    "Relief",
    "View",
    "extract",
    "register",
    "thumbnail",
]
