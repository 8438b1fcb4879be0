"""Pages, tables and figures about a run."""
