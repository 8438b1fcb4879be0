"""A pickle that writes a file where it is loaded."""

import pathlib


class Writes:
    """Pickles to a call that writes the file."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return pathlib.Path.write_text, (self.file, "this code was run")
