"""RLBench's item in the drawer: pull the drawer open, then put the item in."""
