"""Measurements of the tasks on the table."""
