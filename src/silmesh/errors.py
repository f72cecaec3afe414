"""The one error for what a user gave wrongly: a file, a value, a table."""


class InputError(ValueError):
    """What the user gave cannot be used.

    The message is one or a few lines that name the file, the value found there, and what would
    be right. It is shown as it is, without a traceback.
    """
