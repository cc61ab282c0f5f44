"""Surfaces that a camera sees: views, weights of fragments, facets, surroundings."""
