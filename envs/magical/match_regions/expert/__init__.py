"""The scripted expert of MatchRegions, which makes demonstrations."""
