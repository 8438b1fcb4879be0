"""Rewards from action-free demonstration videos; policies trained on them, compiled end to end."""

__version__ = "0.1.0"
