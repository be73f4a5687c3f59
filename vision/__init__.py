"""From pixels to verdicts: camera model, ground projection, detectors. Pure."""
