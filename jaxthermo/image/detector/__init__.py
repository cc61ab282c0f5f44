"""Detectors: frames behind the lens, with lag, noise, counts and gain."""
