"""Encoders trained in 26 ways, each choice changed alone."""
