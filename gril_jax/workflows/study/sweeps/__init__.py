"""Every combination of some options, with several seeds."""
