"""Measurements and reports that can be run again by name."""
