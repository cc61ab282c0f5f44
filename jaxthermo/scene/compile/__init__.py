"""A scene to the program that computes it."""
