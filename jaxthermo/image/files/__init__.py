"""Files of frames and surfaces, of this package and of real cameras."""
