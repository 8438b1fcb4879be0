"""Shoes into their box, the lid first."""
