"""Temporal cycle-consistency; one module for each form."""
