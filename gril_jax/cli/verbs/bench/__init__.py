"""`gril bench`: verbs that measure what is fast on this machine."""
