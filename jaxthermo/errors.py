"""The one exception for a mistake that the user can mend."""


class InputError(ValueError):
    """A user's mistake, told in one line: what is wrong, where, what to do.

    The command line prints the message and exits with status 2; anything else that is
    raised is a defect of ours and keeps its traceback.
    """
