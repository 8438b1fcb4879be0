"""Rigid bodies in the plane, in JAX, in a Warp kernel or in MuJoCo MJX."""
