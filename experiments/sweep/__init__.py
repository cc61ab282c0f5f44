"""Sweeps: error and run time over axes of a scene."""
