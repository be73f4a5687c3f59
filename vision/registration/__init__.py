"""Registration: poses refined by the overlap of pictures. Pure: no file, clock or random number.

picture -> thumbnail -> extract -> View (features and tags) -> register -> Registration
"""
