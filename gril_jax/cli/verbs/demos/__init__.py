"""`gril demos`: verbs that make demonstration sets."""
