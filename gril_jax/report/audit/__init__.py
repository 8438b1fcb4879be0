"""The page of an audit: its findings in numbers and words, and pictures of states."""
