"""Cameras, thermal images, palettes and files."""
