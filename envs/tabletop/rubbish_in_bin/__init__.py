"""RLBench's rubbish in the bin: a piece of rubbish among two tomatoes."""
