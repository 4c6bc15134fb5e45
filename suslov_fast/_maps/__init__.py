"""The maps of the package, one record each."""
