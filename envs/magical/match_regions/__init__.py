"""MAGICAL: MatchRegions."""
