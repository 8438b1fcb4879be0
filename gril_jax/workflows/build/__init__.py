"""Builds the parts of an experiment from a configuration."""
