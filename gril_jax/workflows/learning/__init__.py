"""Training of encoders and of policies, several seeds in one compiled program."""
