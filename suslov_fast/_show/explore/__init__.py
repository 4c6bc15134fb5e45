"""The page of `suslov-fast explore` and its server."""
