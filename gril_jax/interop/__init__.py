"""Files that leave the house, and adapters to other libraries: one file each."""
