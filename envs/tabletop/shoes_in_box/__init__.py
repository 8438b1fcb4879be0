"""RLBench's shoes in the box: open its lid, then put both shoes in."""
