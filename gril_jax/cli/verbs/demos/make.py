"""`gril demos make`: scripted demonstrations."""

from gril_jax.config import MakeDemosConfig
from gril_jax.errors import ConfigError

from ...arguments import Work, demo_set_to_write, explained, in_full, positional, take
from ...verb import Verb, experiment

_SHORTCUTS = {
    "--num": "--demos.num",
    "--failures": "--demos.num-failures",
    "--variant": "--demos.variant",
    "--seed": "--demos.seed",
}


def _plan(args: list[str]) -> Work:
    from gril_jax.config.files import load

    name, out = positional(args), take(args, "--out")
    about = explained(
        "Make scripted demonstrations in the new folder that --out names.", _SHORTCUTS
    )
    args, prog = in_full(args, _SHORTCUTS), "gril demos make"
    config = load(
        name, args, schema=MakeDemosConfig, prog=prog, description=explained(about, _SHORTCUTS)
    )
    if out is None:
        raise ConfigError("gril demos make needs --out, the folder of the demonstration set")
    folder = demo_set_to_write(out)
    return experiment("pipeline.make_demos", config, folder, config=config, devices=True)


VERB = Verb("demos make [CONFIG]", "scripted demonstrations", _plan)
