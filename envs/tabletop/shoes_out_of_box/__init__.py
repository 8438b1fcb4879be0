"""RLBench's shoes out of the box: open its lid, then take both shoes out."""
