"""A chunk of training in one compiled call: updates, then an evaluation of what they made.

    run = jax.jit(partial(chunk, algorithm, updates=20, evaluation=(env,)), donate_argnums=0)
    state, metrics, evaluation = run(state, hyper, reward_params)

The evaluation plays whole episodes from the starts of the given tasks, half of them with the
policy's mean actions and half with samples. It goes through the same unroll as training does: the
simulator, most of what there is to compile, is in the program once. All of it can be vmapped over
seeds, hyper-parameters and rewards.

A step's keys are split off all at once: each place that derives or draws something is a loop of its
own to compile, a tenth to a fifth of a second on a CPU.

Shapes use B for environments, T for the control steps of an unroll and V for variants of the task.
"""

import copy
import dataclasses
import math
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from .episodes import Episodes, Lane
from .rollout import Steps

__all__ = ["Algorithm", "Scores", "chunk", "rounds", "step"]


@runtime_checkable
class Algorithm(Protocol):
    """What PPO and SAC offer; the state has `fleet`, `key` and `replay`, which may be `()`.

    The two halves of a step take as many keys as they say here.
    """

    episodes: Episodes
    num_envs: int
    unroll_length: int
    keys_to_collect: int
    keys_to_learn: int

    def init(self, key: PRNGKeyArray, hyper: Any) -> Any: ...

    def collect(
        self, state: Any, keys: Key[Array, "K"], hyper: Any, reward_params: Any, *,
        deterministic: Bool[Array, "B"],
    ) -> tuple[Any, Steps]: ...  # the state with its fleet moved on  # fmt: skip

    def store(
        self, state: Any, steps: Steps, *, wanted: Bool[Array, ""] | bool = True
    ) -> Any: ...  # the state with these steps in its replay, if wanted

    def learn(
        self, state: Any, steps: Steps, keys: Key[Array, "K"], hyper: Any, reward_params: Any
    ) -> tuple[Any, dict[str, Float[Array, ""]]]: ...  # leaves the replay as it is


class Scores(NamedTuple):
    """What episodes came to: means of shape (V, 2), the last axis (mean actions, samples)."""

    success: Float[Array, "..."]  # at the end of the episode
    success_ever: Float[Array, "..."]  # at some moment of it
    score: Float[Array, "..."]  # at the end
    reward: Float[Array, "..."]  # sum over the episode of what the policy was trained on


def step(
    algorithm: Algorithm, state: Any, hyper: Any, reward_params: Any
) -> tuple[Any, dict[str, Float[Array, ""]]]:
    """One unroll of every environment and what is learned from it: (state, metrics)."""
    key, to_collect, to_learn, _ = _split(algorithm, state.key)
    exploring = jnp.zeros((algorithm.num_envs,), bool)
    state, steps = algorithm.collect(
        state._replace(key=key), to_collect, hyper, reward_params, deterministic=exploring
    )
    state = algorithm.store(state, steps)
    return algorithm.learn(state, steps, to_learn, hyper, reward_params)


def _split(algorithm: Algorithm, key: PRNGKeyArray, more: int = 0) -> tuple[Any, ...]:
    """The key of the next step, those of the two halves of this one, and `more` for other uses."""
    learning = 1 + algorithm.keys_to_collect
    used = learning + algorithm.keys_to_learn
    keys = jax.random.split(key, used + more)  # whose first do not depend on how many there are
    return keys[0], keys[1:learning], keys[learning:used], keys[used:]


def rounds(algorithm: Algorithm) -> int:
    """Unrolls that an evaluation takes: enough for one whole episode."""
    return math.ceil(algorithm.episodes.env.episode_length / algorithm.unroll_length)


def chunk(
    algorithm: Algorithm,
    state: Any,
    hyper: Any,
    reward_params: Any,
    *,
    updates: int,
    evaluation: tuple[Any, ...] = (),
    count: Int[Array, ""] | int | None = None,
    examine: Bool[Array, ""] | bool = True,
) -> tuple[Any, dict[str, Float[Array, "updates"]], Scores | None]:
    """Updates, then one episode of the new policy in each of the B environments.

    Training goes on afterwards where it stood: an evaluation changes nothing in the state. How
    often the loop runs may be traced, so that where a run is cut into chunks changes no bit of it:
    a compiler that knows the number may unroll a short loop, and round otherwise.

    Args:
      algorithm: PPO or SAC.
      state: from its `init`, or the chunk before.
      hyper: its traced parameters.
      reward_params: of its reward.
      updates: room for so many, at least 1.
      evaluation: tasks to evaluate in, which differ in how episodes start only; none leaves the
        evaluation out. The environments are shared out between them: 2 V divides B.
      count: updates to make, at most and by default `updates`; under a vmap the same for all.
      examine: whether to evaluate this time; under a vmap the same for all.

    Returns:
      The state, the metrics of each update (0 beyond `count`), and the evaluation: zeros where it
      has been left out this time, None if there never is one.
    """
    count = updates if count is None else count
    algorithm = _traced_once(algorithm)
    shapes = jax.eval_shape(lambda s: step(algorithm, s, hyper, reward_params)[1], state)
    rows = jax.tree.map(lambda x: jnp.zeros((updates, *x.shape), x.dtype), shapes)
    if not evaluation:

        def update(number, carry):
            state, rows = carry
            state, metrics = step(algorithm, state, hyper, reward_params)
            return state, _write(rows, number, metrics)

        return *jax.lax.fori_loop(0, count, update, (state, rows)), None

    def move(number, carry):
        state, exams, rows = carry
        examining = number >= count
        # The key of training stays where it is while policies are examined.
        turn = _choose(examining, exams.key, state.key)
        key, to_collect, to_learn, _ = _split(algorithm, turn)
        fleet = state.fleet._replace(lanes=_choose(examining, exams.lanes, state.fleet.lanes))
        after, steps = algorithm.collect(
            state._replace(fleet=fleet, key=key), to_collect, hyper, reward_params,
            deterministic=exams.deterministic & examining,
        )  # fmt: skip

        # A branch that handed the replay on would copy all of it.
        after = algorithm.store(after, steps, wanted=~examining)

        def train():
            learned, metrics = algorithm.learn(after, steps, to_learn, hyper, reward_params)
            return learned._replace(replay=()), exams, _write(rows, number, metrics)

        def mark():
            marked = _mark(exams._replace(lanes=after.fleet.lanes, key=key), steps)
            return state._replace(replay=()), marked, rows

        # The same for all seeds, so that under a vmap, too, only one of the branches runs.
        state, exams, rows = jax.lax.cond(examining, mark, train)
        return state._replace(replay=after.replay), exams, rows

    *_, keys = _split(algorithm, state.key, algorithm.num_envs + 1)  # none that the next step has
    exams = _begin(algorithm, evaluation, keys)
    until = count + rounds(algorithm) * jnp.asarray(examine, jnp.int32)
    state, exams, rows = jax.lax.fori_loop(0, until, move, (state, exams, rows))
    shares = (len(evaluation), 2, -1)
    return state, rows, jax.tree.map(lambda x: jnp.mean(x.reshape(shares), -1), exams.marks)


def _write(rows: Any, number: Int[Array, ""], values: Any) -> Any:
    return jax.tree.map(lambda row, x: row.at[number].set(x), rows, values)


def _traced_once(algorithm: Algorithm) -> Algorithm:
    """The same algorithm; its halves are traced once, though a chunk looks at them twice."""
    same = copy.copy(algorithm)
    same.collect, same.learn = jax.jit(algorithm.collect), jax.jit(algorithm.learn)
    return same


class _Exams(NamedTuple):
    """Episodes that are being played for an evaluation, one in each environment."""

    lanes: Lane
    deterministic: Bool[Array, "B"]  # who plays mean actions
    over: Bool[Array, "B"]
    marks: Scores  # (B,) each
    key: PRNGKeyArray


def _begin(algorithm: Algorithm, tasks: tuple[Any, ...], keys: Key[Array, "K"]) -> _Exams:
    """Fresh starts, those of the first task first; of each task, mean actions come first."""
    share = algorithm.num_envs // len(tasks)
    lanes = [
        jax.vmap(dataclasses.replace(algorithm.episodes, env=task).begin)(
            keys[i * share : (i + 1) * share]
        )
        for i, task in enumerate(tasks)
    ]
    lanes = jax.tree.map(lambda *parts: jnp.concatenate(parts), *lanes)
    nothing = jnp.zeros((algorithm.num_envs,))
    deterministic = jnp.arange(algorithm.num_envs) % share < share // 2
    return _Exams(lanes, deterministic, nothing > 0, Scores(*[nothing] * 4), keys[-1])


def _mark(exams: _Exams, steps: Steps) -> _Exams:
    """The exams after one more unroll; what follows the end of an episode does not count."""
    ends = jnp.cumsum(steps.ended, axis=0) + exams.over
    playing = (ends - steps.ended == 0).astype(jnp.float32)  # (T, B)
    last = playing * steps.ended
    success, score = (steps.moment.metrics[name] for name in ("success", "score"))
    marks = Scores(
        success=exams.marks.success + jnp.sum(last * success, axis=0),
        success_ever=jnp.maximum(exams.marks.success_ever, jnp.max(playing * success, axis=0)),
        score=exams.marks.score + jnp.sum(last * score, axis=0),
        reward=exams.marks.reward + jnp.sum(playing * steps.moment.reward, axis=0),
    )
    return exams._replace(over=ends[-1] > 0, marks=marks)


def _choose(first: Bool[Array, ""], one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)
