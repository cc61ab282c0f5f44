"""Steps from voxels to nodes and links that the kinds of structure share."""
