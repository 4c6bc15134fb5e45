"""`python -m suslov_fast` is the command `suslov-fast`."""

from ._cli import main

if __name__ == "__main__":
    main()
