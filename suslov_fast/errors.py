"""The errors that come from the mathematics: their base class, and a search that fails."""


class SuslovError(Exception):
    """Base class of errors that come from the mathematics, not from a wrong argument.

    The errors are :class:`NotIntegrableError`, :class:`SingularStepError` and
    :class:`NoConvergence`. Wrong arguments raise a ValueError or a TypeError instead.

    Examples
    --------
    >>> from suslov_fast import SuslovError, SuslovND
    >>> try:
    ...     SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]).first_integral([1, 1, 1], eps=0.1)
    ... except SuslovError as error:
    ...     print(type(error).__name__)
    NotIntegrableError
    """


class NoConvergence(SuslovError):
    """:func:`periodic_orbit` found no orbit near the start and the period that it was given.

    The message says what was found instead: an equilibrium, an equilibrium to which the motion
    decays, or a motion that ends.

    Examples
    --------
    >>> from suslov_fast import NoConvergence, periodic_orbit
    >>> try:
    ...     periodic_orbit(lambda x: (x[1], -x[0] - x[1] / 5), [1.0, 0.0])
    ... except NoConvergence as error:
    ...     print("equilibrium" in str(error))
    True
    """
