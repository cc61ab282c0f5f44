"""From depth layers to solid voxels and surface fragments with true areas."""
