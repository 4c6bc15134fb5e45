"""`python -m suslov_fast` is the command `suslov-fast`."""

import sys

from .command import main

if __name__ == "__main__":
    sys.exit(main())
