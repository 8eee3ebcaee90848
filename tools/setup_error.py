"""The error that the set-up shows its user."""


class SetupError(Exception):
    """The environment cannot be made; ``str(error)`` is one sentence that says what to do."""
