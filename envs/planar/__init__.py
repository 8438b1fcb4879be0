"""Rigid bodies in the plane, in JAX or in MuJoCo MJX."""
