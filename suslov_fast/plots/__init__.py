"""Phase portraits of bodies (extra `plots`), and the page of `explore`."""
