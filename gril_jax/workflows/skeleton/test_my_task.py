"""Tests of the task: pytest test_my_task.py"""

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
from my_task import make

HERE = Path(__file__).parent


def test_the_task_keeps_the_contract():
    command = [sys.executable, "-m", "gril_jax.cli.main", "check-task", "my_task.py:make"]
    done = subprocess.run(command, cwd=HERE, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_block_that_is_not_touched_stays():
    task = make()
    first = task.reset(jax.random.key(0))
    after = jax.jit(task.step)(first, jnp.zeros(task.action_size))
    assert (after.objects.center == first.objects.center).all()
