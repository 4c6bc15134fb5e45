"""Results: their arrays, files, datasets and figures."""
