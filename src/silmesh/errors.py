"""The one error for what a user gave wrongly: a file, a value, a table."""

import re
import reprlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

LONGEST = 8000  # most characters of a message
WORDS = 200  # most characters of a library's own message in ours
NAMED = 3  # most names that a message lists
UNPRINTABLE = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f]"
)  # control characters, which would move a terminal's cursor


class InputError(ValueError):
    """What the user gave cannot be used.

    The message is one or a few lines that name the file, the value found there, and what would
    be right. It is shown as it is, without a traceback. What is too long for a person is cut.
    """

    def __init__(self, message: str = ""):
        text = UNPRINTABLE.sub(lambda found: ascii(found[0])[1:-1], message)
        super().__init__(cut(text, LONGEST))


@contextmanager
def blaming(where: object) -> Iterator[None]:
    """Put a file, a key or a run before the message of an InputError that the block raises."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


@contextmanager
def reading(path: object, what: str) -> Iterator[None]:
    """Make an InputError of whatever a library raises over the content of a file.

    Readers of other people raise errors of any kind over a damaged file, so this catches all of
    them; its block is the call of that reader, and no work of ours.

    Args:
        path: of the file
        what: it is read as, for example ``an image``
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{path}: cannot be read as {what}: {explain(error)}") from error


def explain(error: BaseException) -> str:
    """What a library's error says, in a line for a person."""
    if isinstance(error, MemoryError):
        return "it would take more memory than there is"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    said = cut(" ".join(str(error).split()), WORDS)
    if type(error) in (ValueError, OSError) and said:
        return said
    return f"{type(error).__name__}{': ' if said else ''}{said}"


def cut(text: str, most: int) -> str:
    """A text whose middle is left out if it is longer than so many characters."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} [... {len(text) - 2 * half:,} characters ...] {text[-half:]}"


def name_some(names: Sequence[object], most: int = NAMED) -> str:
    """Some of many names, and how many more there are: ``a, b, c and 4 more``."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(map(str, names[:most])) + more


def shorten(value: object, most: int = 120) -> str:
    """A value that was found, as a message shows it: not all of what is long or deep."""
    shown = reprlib.Repr()
    shown.maxlevel, shown.maxstring, shown.maxother, shown.maxlong = 4, most, most, 40
    shown.maxlist = shown.maxtuple = shown.maxdict = shown.maxset = 6
    try:
        return cut(shown.repr(value), 3 * most)
    except ValueError:  # Python writes no number of more than 4300 digits
        return f"{type(value).__name__} that is too long to show"
