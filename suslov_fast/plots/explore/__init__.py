"""The page of `suslov-fast explore`: its numbers and its server."""
