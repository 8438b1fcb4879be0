"""Tasks of one's own: from the file that a user names to a task that keeps the contract.

`files` finds and runs the file, `completed` fills in what the contract leaves open, `protocol` and
`episodes` say in sentences what is missing, `adapters` make a task of an environment of another
library.
"""
