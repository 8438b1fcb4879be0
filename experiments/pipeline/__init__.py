"""From a configuration to what the experiments compose."""
