"""Conduction operators of a body: dense stencils and links, with multigrid."""
