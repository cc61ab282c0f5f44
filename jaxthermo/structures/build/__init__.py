"""Voxels to nodes and links: the steps that the kinds of structure share."""
