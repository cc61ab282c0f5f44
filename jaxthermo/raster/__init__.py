"""Which triangles each pixel's ray crosses, at which depth, in order."""
