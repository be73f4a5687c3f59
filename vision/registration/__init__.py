"""Registration: poses refined by the overlap of pictures. Pure: no file, clock or random number.

picture -> thumbnail -> extract -> View (features and tags) -> register -> Registration
"""

from vision.registration.picture_features import WIDTH_PX, extract, thumbnail
from vision.registration.registering import Many, register
from vision.registration.relief import Relief
from vision.registration.result import Agreement, Net, Registration
from vision.registration.views import Described, Features, Prior, Refined, View

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
