"""`gril bench replay`: the replay buffer beside brax's."""

from ...bench import benchmark

VERB = benchmark("replay", "the replay buffer beside brax's, alone and for eight seeds")
