"""Values only: one YAML file for each named configuration."""

if __name__ != "gril_jax.configs":  # a second copy would be a second module tree
    raise ImportError(f"import this package as gril_jax.configs, not {__name__}")
