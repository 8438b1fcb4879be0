"""The long tasks of the table, each with rewards of all kinds."""
