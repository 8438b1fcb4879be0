"""`gril bench losses`: the losses and encoders beside those of other libraries."""

from ...bench import benchmark

__all__ = ["VERB"]

VERB = benchmark("losses", "the losses and encoders beside those of other libraries")
