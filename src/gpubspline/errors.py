"""The exceptions and the warning of the project: what was expected, what came, what to do."""


class GpubsplineError(Exception):
    """Base of every error this package raises on purpose; the command line prints it as one line."""


class InputError(GpubsplineError, ValueError):
    """Data, an option or a file is not what the called function can work with."""


class NoSectionsError(InputError):
    """A body's sections are not what five patches a section can fill.

    Attributes
    ----------
    found: what a section is instead, and where, to be put in a sentence.
    """

    def __init__(self, message: str, found: str) -> None:
        super().__init__(message)
        self.found = found


class BackendUnavailable(GpubsplineError, RuntimeError):
    """A kernel backend or device is not present; the message names what to install."""


class SolveError(GpubsplineError, ArithmeticError):
    """A system of equations was not solved to the accuracy asked for."""


class MeshError(GpubsplineError, RuntimeError):
    """No mesh worth writing was found; the message says where it fails and what to try."""


class GpubsplineWarning(UserWarning):
    """The result stands, but the user should know something about it."""


def expect(value: object, kind: type, how: str) -> None:
    """Raise InputError where an argument is of another kind; ``how`` says what gives one of this."""
    if not isinstance(value, kind):
        raise InputError(f"expected a {kind.__name__}, got {type(value).__name__}: {how}")
