"""Tells what a study would train, without training: `gril sweep STUDY --dry-run`."""

from collections.abc import Callable

from gril_jax.errors import DemoError
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.policy_setup import policy_config

from . import driver
from .saved import Plan, learns


def main(plan: Plan, videos: str | None, echo: Callable[[str], None] = print) -> int:
    """Says it row by row, and writes nothing. Errors are those of `driver.make_sets` and
    `driver.make`; a demonstration set that would be made first is one, too."""
    rows = plan.runs
    for out in driver.missing_sets([plan.rows[name] for name in plan.work], videos):
        raise DemoError(
            f"{out} would be made first, but a dry run makes no demonstration set: leave out "
            "--dry-run, or name the sets that there are with --sets"
        )
    driver.require_possible(plan, rows, new=True)
    in_all = 0
    for name, seeds in plan.work.items():
        config, said = plan.rows[name], []
        if learns(config):
            said.append(f"a reward, {config.pretrain.steps:,} gradient steps")
        if plan.study.policies:
            steps = policy_config(config).num_timesteps
            in_all += steps * len(seeds)
            said.append(f"a policy of {config.env.shown_name}, {steps:,} env steps")
        echo(f"{name}: {'; '.join(said) or 'nothing without its policy'}; {len(seeds)} seeds")
    more = f", {in_all:,} env steps" if in_all else ""
    counts = driver.counts_of(rows, driver.programs_of(plan, rows))
    shared = counts["rewards"] < sum(learns(row.config) for row in rows)
    more += ", and rows that learn the same reward share it" * shared
    echo(f"in all {driver.in_words(counts)}{more}, on {setup.device_in_words()}")
    return 0
