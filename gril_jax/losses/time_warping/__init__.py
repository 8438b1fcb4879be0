"""Soft-DTW and DTW; `gril_jax.losses` lists their functions."""
