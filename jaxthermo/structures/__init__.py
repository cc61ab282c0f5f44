"""Structures: nodes, links and surface maps that the heat equation is solved on."""
