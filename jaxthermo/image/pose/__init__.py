"""Poses of cameras, and how frames change with them."""
