"""A task, an encoder, a loss, a form of the reward and an algorithm, each a file and one line."""

import sys
from pathlib import Path

FILES = {
    "dummy_encoder": """
import dataclasses
import jax
import jax.numpy as jnp

@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class DummyConfig:
    num_classes: int
    width: int = 4
    latent: int = 2
    pool_robot: bool = False
    length_unit: float = 1.0

    @classmethod
    def of(cls, options, num_classes):
        return cls(num_classes, latent=options.latent)

def init(key, config):
    return {"dummy_kernel": jax.random.normal(key, (4, config.latent))}

def apply(params, graph, config):
    nodes = graph.nodes
    seen = jnp.concatenate([nodes.center, nodes.size], -1) * nodes.present[:, None]
    return jnp.tanh(seen @ params["dummy_kernel"]).mean(0)
""",
    "dummy_loss": """
import jax.numpy as jnp

def loss(frames):
    return 7.0 + 0.0 * jnp.sum(frames.latents)
""",
    "dummy_form": """
import jax.numpy as jnp
from gril_jax.workflows.build.policy_rewards import RewardForm

def _five(params, state, active):
    return 5.0 + 0.0 * params

FORM = RewardForm(lambda config, env: _five, lambda config, learned, demos, classes: jnp.zeros(()))
""",
    "dummy_algorithm": """
import jax.numpy as jnp
from gril_jax.rl.ppo import PPO

class Dummy(PPO):
    def learn(self, state, steps, key, hyper, reward_params):
        state, metrics = super().learn(state, steps, key, hyper, reward_params)
        return state, metrics | {"dummy": jnp.float32(3)}
""",
}


OPTIONS = (
    *("--encoder.kind", "dummy", "--encoder.latent", "3", "--loss.consistency", "dummy"),
    *("--loss.decoder", "graph", "--loss.warmup", "0"),
    *("--run.reward", "dummy", "--run.algorithm", "dummy"),
    *("--dummy.num-envs", "4", "--dummy.unroll-length", "5", "--dummy.num-timesteps", "20"),
    *("--dummy.hidden", "8"),
)


def main(folder: str) -> int:
    """Trains with all five, whose files go into a folder, and evaluates, by the command line."""
    config = new_task.write(Path(folder))
    for name, text in FILES.items():
        Path(folder, f"{name}.py").write_text(text)
    sys.path.insert(0, folder)
    from gril_jax.envs import registry

    from gril_jax.config import tables

    registry.TASKS["reach"] = "reach_task:SPEC"
    tables.ENCODERS["dummy"] = tables.Encoder("dummy_encoder.DummyConfig")
    tables.ALIGNMENTS["dummy"] = tables.Alignment(("dummy_loss.loss",))
    tables.REWARDS["dummy"] = tables.Reward("dummy_form.FORM")
    tables.ALGORITHMS["dummy"] = tables.Algorithm(
        "dummy_algorithm.Dummy", "gril_jax.config.policy.PPOConfig"
    )
    from gril_jax.cli.main import main

    out = str(Path(folder, "run"))
    return main(["train", str(config), "--out", out, *OPTIONS]) or main(["eval", out])


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[1]))
    from support import new_task

    sys.exit(main(sys.argv[1]))
