"""Entry points of the command line: each module has `main(config)`."""

if __name__ != "gril_jax.experiments":  # a second copy would be a second module tree
    raise ImportError(f"import this package as gril_jax.experiments, not {__name__}")
