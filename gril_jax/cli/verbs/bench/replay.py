"""`gril bench replay`: the replay buffer beside brax's."""

from ...bench import benchmark

__all__ = ["VERB"]

VERB = benchmark(
    "replay",
    "the replay buffer beside brax's, alone and for eight seeds",
    "The replay of soft actor-critic beside brax's, alone and with 8 seeds, as JSON.",
)
