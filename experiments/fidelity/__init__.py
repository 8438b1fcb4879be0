"""Comparisons of our physics with the original's."""
