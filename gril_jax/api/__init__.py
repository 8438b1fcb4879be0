"""The functions of the package's front door: from videos to a reward, from a reward to a policy."""
