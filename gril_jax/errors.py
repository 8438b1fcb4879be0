"""What a user can cause: every such error is one sentence with what would be right."""

__all__ = ["ConfigError", "DemoError", "GrilError", "RunError", "ShapeError"]


class GrilError(Exception):
    """Base of every error that a user can cause; its text is one sentence."""


class ConfigError(GrilError):
    """A configuration field or command-line option is unknown or out of range."""


class DemoError(GrilError):
    """A demonstration, video or boxes file is missing, damaged or not what it should be."""


class RunError(GrilError):
    """A run folder is missing, incomplete, or being written by another process."""


class ShapeError(GrilError, ValueError):
    """Arrays whose shapes do not fit together; the text names both."""
