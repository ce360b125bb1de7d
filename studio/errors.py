"""The one exception that the library raises for bad input.

Its message is a whole sentence that names the file, the value found there and
the mend. Command line and window show it as it is, without a traceback.
"""


class StudioError(Exception):
    """Bad input: footage, calibration, settings or stream. The text is for the user."""


class Cancelled(Exception):
    """Raised inside long work when its `progress` callback asked it to stop."""
