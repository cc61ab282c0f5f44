"""Bodies and terms, compiled to the smallest program that does the scene."""
