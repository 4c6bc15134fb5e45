"""The command `suslov-fast`."""
