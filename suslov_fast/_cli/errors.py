"""What a user did wrong, for the command line to say in one line."""


class UserError(Exception):
    """A bad value, a missing or malformed file, or a path that cannot be written to."""
