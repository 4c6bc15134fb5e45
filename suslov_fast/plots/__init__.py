"""Phase portraits of bodies (extra `plots`)."""
