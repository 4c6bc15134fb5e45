"""Fields: right-hand sides from functions of users, as terms and as lists of operations."""
