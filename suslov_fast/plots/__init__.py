"""Pictures of runs and bodies (extra `plots`), and the page of `explore`."""
