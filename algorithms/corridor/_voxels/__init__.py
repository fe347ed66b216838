"""The steps of corridor.extract_voxels on arrays: voxels, growing, towers and the hull."""
