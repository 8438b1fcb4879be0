"""Studies that `gril sweep NAME` runs: one YAML file each, as `workflows/study/recipe.py` reads."""
