"""Nodes, links and the surface map: what the heat equation is solved on."""
