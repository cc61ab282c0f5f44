"""Readers of mesh files: one module for each format, and the triangulation of faces."""
