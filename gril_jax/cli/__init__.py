"""The command line: `gril VERB`."""
