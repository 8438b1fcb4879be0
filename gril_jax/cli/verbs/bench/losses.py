"""`gril bench losses`: the losses beside those of other libraries."""

from ...bench import benchmark

VERB = benchmark("losses", "the losses beside those of other libraries")
