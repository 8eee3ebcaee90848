"""Errors a user can act on. Only the command line and the operators turn them into text."""

from facestage.contract.wording import one_line

EXIT_DONE = 0  # a command's exit code; that of a failure is its error's
EXIT_SOME_FAILED = 5  # of a batch: rows without a result, whatever came of the others


class FacestageError(Exception):
    """Base class: ``str(error)`` is one sentence with what was expected, found, and what to do."""

    exit_code = 2

    def __str__(self) -> str:
        """The sentence in one line, whatever names and values of the user's it repeats."""
        return one_line(super().__str__())


class InputError(FacestageError):
    """A file or an option is wrong; the sentence names it. Exit code 2."""


class CancelledError(FacestageError):
    """The user stopped the run; the last checkpoint is kept. Exit code 3."""

    exit_code = 3


class BackendUnavailableError(FacestageError):
    """No renderer works on this machine; the sentence says what to install. Exit code 4."""

    exit_code = 4
