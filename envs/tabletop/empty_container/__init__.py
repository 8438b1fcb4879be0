"""RLBench's empty container: bring three things from the tray into a bin."""
