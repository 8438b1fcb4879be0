"""Short programs that learn, save, load and use a reward: each has `main`, and runs with `-m`."""
