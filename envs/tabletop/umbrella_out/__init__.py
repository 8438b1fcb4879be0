"""RLBench's umbrella out of its stand: grasp it and lift it out."""
