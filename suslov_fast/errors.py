"""The base class of the errors of this package."""


class SuslovError(Exception):
    """Base class of errors that come from the mathematics, not from a wrong argument.

    They are :class:`NotIntegrableError` and :class:`SingularStepError`. Wrong arguments are a plain
    ValueError or TypeError.

    Examples
    --------
    >>> from suslov_fast import SuslovError, SuslovND
    >>> try:
    ...     SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]).first_integral([1, 1, 1], eps=0.1)
    ... except SuslovError as error:
    ...     print(type(error).__name__)
    NotIntegrableError
    """
