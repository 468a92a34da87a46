"""Data factory: randomised glider missions in bulk, written to one zarr store."""
