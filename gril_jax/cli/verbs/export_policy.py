"""`gril export-policy`: a run's policy as plain NumPy arrays."""

from dataclasses import dataclass
from pathlib import Path

from gril_jax.config.command_line import RunFolder, parse

from ..arguments import Work, echo, require_new_file, run_config_of
from ..heavy_imports import heavy_imports
from ..verb import Verb


@dataclass(frozen=True)
class _Options:
    run: RunFolder
    """The folder that a run made."""
    out: str
    """File to create, such as policy.npz."""


def _plan(args: list[str]) -> Work:
    about = "Write a run's policy as an npz file that needs NumPy alone."
    given = parse(_Options, args, prog="gril export-policy", description=about)
    folder, out = Path(given.run), Path(given.out)
    config = run_config_of(folder, "policy")
    require_new_file(out)

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.experiments.pipeline import policy_setup, setup
            from gril_jax.interop import policy_file
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        hyper = policy_setup.algorithm_hyper(config)
        policy_file.main(folder, out, config, algorithm, hyper, echo=echo)

    return work


VERB = Verb("export-policy RUN", "a run's policy as plain NumPy arrays", _plan)
