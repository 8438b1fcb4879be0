"""The engine of a planar scene as one NVIDIA Warp kernel: a thread an episode, a launch a step."""
