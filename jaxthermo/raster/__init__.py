"""Rasterization: the triangles that each pixel's ray crosses, sorted by depth."""
