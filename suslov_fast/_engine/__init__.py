"""From checked arguments to loops: layout, slices, threads."""
