"""Tasks of one's own: a file that a user names, from its reference to a task that keeps the contract.

`files` finds and runs the file, `completed` fills in what the contract leaves open, `protocol` says
in sentences what is missing, `adapters` make a task of an environment of another library.
"""
