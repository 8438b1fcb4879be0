"""Demonstrations in Python."""

import os

from gril_jax.demos.demo_set import DemoSet, load_demo_set


def load_demos(folder: str | os.PathLike) -> DemoSet:
    """The demonstrations in a folder of `import_videos` or of `gril demos`.

    Raises:
      DemoError: there are none, or a file is missing or was changed.

    Example:
      demos = load_demos("mine")
    """
    return load_demo_set(folder)
