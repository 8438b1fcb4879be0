"""From films to boxes, demonstration sets and batches of arrays."""
