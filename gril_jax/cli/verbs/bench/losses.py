"""`gril bench losses`: the losses beside those of other libraries."""

from ...bench import benchmark

__all__ = ["VERB"]

VERB = benchmark("losses", "the losses beside those of other libraries")
