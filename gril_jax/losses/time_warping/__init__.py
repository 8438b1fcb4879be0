"""Soft-DTW and DTW; `gril_jax.losses` lists their functions."""

__all__: list[str] = []
