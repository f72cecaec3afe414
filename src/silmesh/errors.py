"""The one error for what a user gave wrongly: a file, a value, a table."""

from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """What the user gave cannot be used.

    The message is one or a few lines that name the file, the value found there, and what would
    be right. It is shown as it is, without a traceback.
    """


@contextmanager
def blaming(where: object) -> Iterator[None]:
    """Put a file, a key or a run before the message of an InputError that the block raises."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
