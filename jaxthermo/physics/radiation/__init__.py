"""Radiation: sources and shadows, emission, exchange between surfaces."""
