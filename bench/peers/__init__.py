"""Other implementations, one module per library, and loops of users over `suslov_fast.compiled`."""
