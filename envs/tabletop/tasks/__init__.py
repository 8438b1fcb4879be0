"""The tasks on the table: each with its scene, its scripted expert and how that fails."""
