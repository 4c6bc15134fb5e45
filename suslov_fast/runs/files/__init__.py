"""Results outside memory: files, datasets and Zarr stores."""
