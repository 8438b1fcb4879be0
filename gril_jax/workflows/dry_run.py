"""Tells what a run would do, how long it would take here and how much memory: `--dry-run`.

Nothing is written. Parts of the real programs are compiled and timed for a few updates on an
untrained reward. Where the demonstrations would be made first, resting boxes replace them.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from gril_jax.compilation import memory, sharding
from gril_jax.config import RunConfig
from gril_jax.config.tables import ENCODERS
from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.envs import Env
from gril_jax.pretraining import pretrain
from gril_jax.report.headline import in_words
from gril_jax.rl import training
from gril_jax.runs.progress import Phase, Progress
from gril_jax.types import DemoBatch
from gril_jax.workflows import audit, train
from gril_jax.workflows.build import demonstrations, policy_rewards, policy_setup, setup
from gril_jax.workflows.learning import policies

_UNIT = 2**20
_CALLS = 5  # that are timed


def main(config: RunConfig, *, verb: str, echo: Callable[[str], None] = print) -> None:
    """Says it line by line. Errors are those of the run."""
    with Progress() as progress:
        _tell(config, verb, progress, echo)


def _tell(config: RunConfig, verb: str, progress: Progress, echo: Callable[[str], None]) -> None:
    env = setup.task_of(config.env)
    demonstrations.require_usable(config, env)
    if config.run.audit and verb == "train" and env is not None:
        audit.require_possible(config)
    took, needs = 0.0, train.needs_of(config)
    learns = needs.encoder or verb != "train"
    if learns or needs.demos:
        demos, classes = _demonstrations(config, env, echo)
    if learns:
        took = _reward(config, demos, classes, progress, echo)
    about = "about"
    if verb == "train":
        seconds, early = _policy(config, progress, echo)
        took, about = took + seconds, "at most" if early else "about"
    where = config.run.out or "a new folder below runs/"
    makes = config.demos.path is None and (learns or needs.demos)
    made = " after the demonstrations are made" if makes else ""
    device = setup.device_in_words()
    progress.end_phase()  # or its last line would follow
    echo(f"in all {about} {in_words(took)}{made}, on {device}; results go to {where}")


def _reward(
    config: RunConfig, demos: DemoBatch, classes: Sequence[str], progress: Progress,
    echo: Callable[[str], None],
) -> float:  # fmt: skip
    """Seconds that the reward's training would take, compiling included; told."""
    steps = f"reward: {config.pretrain.steps:,} gradient steps"
    if not ENCODERS[config.encoder.kind].boxes:
        echo(f"{steps} on pictures, which are not timed")
        return 0.0
    phase = progress.phase("timing the reward", total=_CALLS, unit="updates")
    begun, members = time.monotonic(), config.encoder.ensemble_size
    static = setup.pretrain_config(config, classes)
    hyper = setup.pretrain_hyper(config)
    step = jax.jit(lambda state: pretrain.step(state, demos, hyper, static, None)[0])
    state = pretrain.init(jax.random.key(0), demos, static)
    took = _seconds(begun, step, state, members * config.pretrain.steps / static.updates, phase)
    echo(f"{steps}, about {in_words(took)}")
    return took


def _seconds(
    begun: float, step: Callable[[Any], Any], state: Any, calls: int | float, phase: Phase
) -> float:
    """Seconds from `begun` until a function is compiled, and for so many calls of it."""
    state = jax.block_until_ready(step(state))
    took = time.monotonic() - begun
    each = []
    while len(each) < _CALLS:  # the median, because a machine may be busy for a moment
        begun = time.monotonic()
        state = jax.block_until_ready(step(state))
        each.append(time.monotonic() - begun)
        phase.update(len(each))
    return took + calls * statistics.median(each)


def _demonstrations(
    config: RunConfig, env: Env | None, echo: Callable[[str], None]
) -> tuple[DemoBatch, Sequence[str]]:
    """The demonstrations, or scenes at rest in their stead, and the classes; told."""
    chosen = config.demos
    if chosen.path is not None:
        demo_set = load_demo_set(chosen.path)
        shown = ", ".join(demo_set.classes if env is None else env.classes)
        echo(f"demonstrations: {len(demo_set)} of {chosen.path}, of {shown}")
        return demo_batch(demo_set), demo_set.classes
    num, frames = chosen.num + chosen.num_validation, config.pretrain.num_frames
    expert = f"the expert of {config.env.shown_name}"
    echo(f"demonstrations: {num} of {expert} would be made first, which is not timed")
    keys = jax.random.split(jax.random.key(0), num)
    seen = jax.jit(jax.vmap(lambda key: env.reset(key).objects))(keys)
    center, size = (jnp.repeat(x[:, None], frames, axis=1) for x in (seen.center, seen.size))
    present, length = jnp.ones(seen.label.shape, bool), jnp.full(num, frames, jnp.int32)
    resting = DemoBatch(center, size, seen.label, seen.is_robot, present, length)
    return resting, env.classes


def _policy(
    config: RunConfig, progress: Progress, echo: Callable[[str], None]
) -> tuple[float, bool]:
    """Seconds that the policy's training would take, compiling included, and whether it may end
    before; told with its memory."""
    phase = progress.phase("timing the policy", total=_CALLS, unit="updates")
    begun = time.monotonic()
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    params = policy_rewards.blank(config, algorithm.episodes.env)
    needed = memory.predict_bytes(algorithm, policy_setup.algorithm_hyper(config), params)
    program, plan = train.compiled_for(config, algorithm), policies.plan_of(config, algorithm)
    init, run_part, shapes = program.functions
    placed = sharding.place(program.layout, jax.tree.map(lambda x: x[None], params))

    def advance(examine: bool) -> Callable[[Any], Any]:
        moves = (training.rounds(algorithm), 0) if examine else (1, 1)  # last, count
        more = program.hyper, placed, *map(jnp.int32, (0, *moves))
        return lambda part: run_part(part, *more)[0]

    part = sharding.begun(init(program.keys, program.hyper), shapes)
    seconds = _seconds(begun, advance(False), part, plan.updates, phase)
    if plan.evaluations:
        phase = progress.phase("timing an evaluation", total=_CALLS, unit="updates")
        part = sharding.begun(init(program.keys, program.hyper), shapes)
        count, begun = min(plan.evaluations, plan.chunks), time.monotonic()
        seconds += _seconds(begun, advance(True), part, count, phase)
    available = memory.available_bytes(jax.devices()[0])
    room = "" if available is None else f" of {available / _UNIT:,.0f} MiB"
    most = plan.least is not None  # evaluations may end it
    steps = plan.updates * plan.steps if most else policy_setup.policy_config(config).num_timesteps
    echo(
        f"policy: {'at most ' * most}{steps:,} env steps by {config.run.algorithm.upper()}, "
        f"{'at most' if most else 'about'} {in_words(seconds)}"
        f"{' (it ends when evaluations no longer improve)' * most}; about "
        f"{needed / _UNIT:,.0f} MiB{room}"
    )
    return seconds, most
