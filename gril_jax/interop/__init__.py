"""Adapters to foreign formats and libraries: one file each."""
