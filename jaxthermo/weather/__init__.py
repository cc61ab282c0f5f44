"""Outdoor scenes: a place and a date become the direction of the sun."""
