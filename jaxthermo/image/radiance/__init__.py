"""Radiance of what a camera sees: bands, effects, frames before the lens."""
