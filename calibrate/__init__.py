"""Fits conduction weights, materials and coefficients to references or thermograms."""
