"""Outdoor scenes: place, date and weather become terms of a scene."""
