"""What the verbs and the Python functions of the package run, from a configuration."""
