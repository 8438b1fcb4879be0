"""Compiling ahead of time, on one device or on several."""
