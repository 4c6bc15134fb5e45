"""The page of `suslov-fast explore`: its numbers, its server, and its widget for notebooks."""
