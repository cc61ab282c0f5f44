"""Fits weights, materials and coefficients to references (no command yet)."""
