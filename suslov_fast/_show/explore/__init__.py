"""What `suslov-fast explore` serves: a page, and the numbers that it shows."""
