"""The page of `suslov-fast explore`, and what serves it."""
