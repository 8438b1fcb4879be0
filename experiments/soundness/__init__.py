"""Whether an audit foretells what a policy makes of a reward."""
