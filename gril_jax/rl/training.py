"""A chunk of training in one compiled call: updates, then an evaluation of the policy.

    run = jax.jit(partial(chunk, algorithm, updates=20, evaluation=(env,)), donate_argnums=0)
    state, metrics, evaluation = run(state, hyper, reward_params)

The evaluation plays whole episodes from the starts of the given tasks, half of them with the
policy's mean actions and half with samples. It goes through the same unroll as training does: the
simulator, most of what there is to compile, is in the program once. All of it can be vmapped over
seeds, hyper-parameters and rewards.

Shapes use B for environments, T for the control steps of an unroll and V for variants of the task.
"""

import copy
import dataclasses
import math
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .episodes import Environment, Episodes, EpisodeState
from .rollout import Rollout


@runtime_checkable
class Algorithm(Protocol):
    """An algorithm, like PPO and SAC; its state has `envs`, `key` and `replay`, which may be `()`.

    Both halves of a step take the step's key and split `num_keys` from it (`gril_jax.rl.agent`);
    the first of them is the key of the next step.
    """

    episodes: Episodes
    num_envs: int
    unroll_length: int
    num_keys: int

    def init(self, key: PRNGKeyArray, hyper: Any) -> Any:
        """The state before any step. The key is consumed."""

    def collect(
        self, state: Any, key: PRNGKeyArray, hyper: Any, reward_params: Any, *,
        deterministic: Bool[Array, "B"],
    ) -> tuple[Any, Rollout]:  # fmt: skip
        """The state with its environments moved on by T control steps, and these steps."""

    def store(self, state: Any, steps: Rollout, *, wanted: Bool[Array, ""] | bool = True) -> Any:
        """The state with these steps in its replay, if they are wanted."""

    def learn(
        self, state: Any, steps: Rollout, key: PRNGKeyArray, hyper: Any, reward_params: Any
    ) -> tuple[Any, dict[str, Float[Array, ""]]]:
        """The state after gradient steps, with the same replay, and metrics by name, each ()."""


class Scores(NamedTuple):
    """Evaluation scores: means of shape (V, 2), the last axis (mean actions, sampled actions)."""

    success: Float[Array, "..."]  # at the end of the episode
    success_ever: Float[Array, "..."]  # at some time in it
    score: Float[Array, "..."]  # at the end
    reward: Float[Array, "..."]  # sum over the episode of what the policy was trained on


def step(
    algorithm: Algorithm, state: Any, hyper: Any, reward_params: Any
) -> tuple[Any, dict[str, Float[Array, ""]]]:
    """Runs one unroll of every environment and learns from it: (state, metrics)."""
    key, exploring = state.key, jnp.zeros((algorithm.num_envs,), bool)
    state, steps = algorithm.collect(
        state._replace(key=_next(algorithm, key)), key, hyper, reward_params,
        deterministic=exploring,
    )  # fmt: skip
    state = algorithm.store(state, steps)
    return algorithm.learn(state, steps, key, hyper, reward_params)


def _next(algorithm: Algorithm, key: PRNGKeyArray) -> PRNGKeyArray:
    return jax.random.split(key, algorithm.num_keys)[0]


def rounds(algorithm: Algorithm) -> int:
    """Number of unrolls in an evaluation: enough for one whole episode."""
    return math.ceil(algorithm.episodes.env.episode_length / algorithm.unroll_length)


class Part(NamedTuple):
    """A chunk of which some moves are made: first its updates, then the rounds of its evaluation.

    Without `playing` it is enough to go on: an evaluation that is lost begins anew.
    """

    state: Any
    rows: dict[str, Float[Array, "updates"]]  # metrics of the updates so far
    key: PRNGKeyArray  # that the evaluation begins with: the state's before the first update
    playing: Any = None  # evaluation episodes in progress; None before there are any


def chunk(
    algorithm: Algorithm,
    state: Any,
    hyper: Any,
    reward_params: Any,
    *,
    updates: int,
    evaluation: tuple[Environment, ...] = (),
    count: Int[Array, ""] | int | None = None,
    examine: Bool[Array, ""] | bool = True,
) -> tuple[Any, dict[str, Float[Array, "updates"]], Scores | None]:
    """Runs updates, then one episode of the new policy in each of the B environments.

    Training goes on afterwards where it stood: an evaluation changes nothing in the state. The
    number of updates may be traced, because a compiler that knows it may unroll a short loop, and
    round otherwise. So a run's results do not depend on where it is cut into chunks.

    Args:
      algorithm, state, hyper, reward_params: as for `step`; the state is replaced.
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
    part = begin(algorithm, state, hyper, reward_params, updates=updates)
    last = count + rounds(algorithm) * jnp.asarray(examine, jnp.int32) if evaluation else count
    part, scores = moved(
        algorithm, part, hyper, reward_params, evaluation=evaluation, first=0, last=last,
        count=count,
    )  # fmt: skip
    return part.state, part.rows, scores


def begin(
    algorithm: Algorithm, state: Any, hyper: Any, reward_params: Any, *, updates: int
) -> Part:
    """A chunk with room for so many updates, of which none is made."""
    shapes = jax.eval_shape(lambda s: step(algorithm, s, hyper, reward_params)[1], state)
    rows = jax.tree.map(lambda x: jnp.zeros((updates, *x.shape), x.dtype), shapes)
    return Part(state, rows, state.key)


def moved(
    algorithm: Algorithm,
    part: Part,
    hyper: Any,
    reward_params: Any,
    *,
    evaluation: tuple[Environment, ...] = (),
    first: Int[Array, ""] | int,
    last: Int[Array, ""] | int,
    count: Int[Array, ""] | int,
) -> tuple[Part, Scores | None]:
    """The chunk after its moves from `first` to before `last`, of which `count` are updates.

    All three may be traced, under a vmap the same for all: where a chunk is cut into calls changes
    no number. Arguments and scores are those of `chunk`; scores count once all rounds are made.
    """
    algorithm = _traced_once(algorithm)
    state, rows = part.state, part.rows
    key = _choose(jnp.asarray(first == 0), state.key, part.key)
    if not evaluation:

        def update(number, carry):
            state, rows = carry
            state, metrics = step(algorithm, state, hyper, reward_params)
            return state, _write(rows, number, metrics)

        state, rows = jax.lax.fori_loop(first, last, update, (state, rows))
        return Part(state, rows, key, part.playing), None

    def move(number, carry):
        state, playing, rows = carry
        evaluating = number >= count
        # The key of training stays where it is while policies are evaluated.
        turn = _choose(evaluating, playing.key, state.key)
        key = _next(algorithm, turn)
        running = _choose(evaluating, playing.episodes, state.envs.running)
        envs = state.envs._replace(running=running)
        after, steps = algorithm.collect(
            state._replace(envs=envs, key=key), turn, hyper, reward_params,
            deterministic=playing.deterministic & evaluating,
        )  # fmt: skip

        # A branch that handed the replay on would copy all of it.
        after = algorithm.store(after, steps, wanted=~evaluating)

        def train():
            learned, metrics = algorithm.learn(after, steps, turn, hyper, reward_params)
            return learned._replace(replay=()), playing, _write(rows, number, metrics)

        def score():
            scored = _scored(playing._replace(episodes=after.envs.running, key=key), steps)
            return state._replace(replay=()), scored, rows

        # The same for all seeds, so that under a vmap, too, only one of the branches runs.
        state, playing, rows = jax.lax.cond(evaluating, score, train)
        return state._replace(replay=after.replay), playing, rows

    playing = fresh_evaluation(algorithm, evaluation, key)
    if part.playing is not None:
        playing = _choose(jnp.asarray(first <= count), playing, part.playing)
    state, playing, rows = jax.lax.fori_loop(first, last, move, (state, playing, rows))
    shares = (len(evaluation), 2, -1)
    scores = jax.tree.map(lambda x: jnp.mean(x.reshape(shares), -1), playing.scores)
    return Part(state, rows, key, playing), scores


def _write(rows: Any, number: Int[Array, ""], values: Any) -> Any:
    return jax.tree.map(lambda row, x: row.at[number].set(x), rows, values)


def _traced_once(algorithm: Algorithm) -> Algorithm:
    """The same algorithm with its halves traced once, though a chunk uses them twice."""
    same = copy.copy(algorithm)
    same.collect, same.learn = jax.jit(algorithm.collect), jax.jit(algorithm.learn)
    return same


class _Evaluation(NamedTuple):
    """Evaluation episodes in progress, one in each environment."""

    episodes: EpisodeState
    deterministic: Bool[Array, "B"]  # who plays mean actions
    over: Bool[Array, "B"]
    scores: Scores  # (B,) each
    key: PRNGKeyArray


def fresh_evaluation(
    algorithm: Algorithm, tasks: tuple[Environment, ...], key: PRNGKeyArray
) -> _Evaluation:
    """Fresh starts, in order of tasks; within each task, mean actions come first.

    The key is that of the step that comes next, which stays usable.
    """
    # Keys that the step has not; the first of them do not depend on how many there are.
    keys = jax.random.split(key, algorithm.num_keys + algorithm.num_envs + 1)
    keys = keys[algorithm.num_keys :]
    share = algorithm.num_envs // len(tasks)
    each = [dataclasses.replace(algorithm.episodes, env=task) for task in tasks]
    starts = keys[:-1].reshape(len(tasks), share)
    parts = [jax.vmap(e.begin)(k) for e, k in zip(each, starts, strict=True)]
    episodes = jax.tree.map(lambda *parts: jnp.concatenate(parts), *parts)
    nothing = jnp.zeros((algorithm.num_envs,))
    deterministic = jnp.arange(algorithm.num_envs) % share < share // 2
    return _Evaluation(episodes, deterministic, nothing > 0, Scores(*[nothing] * 4), keys[-1])


def _scored(playing: _Evaluation, steps: Rollout) -> _Evaluation:
    """The evaluation after one more unroll; what follows the end of an episode does not count."""
    ends = jnp.cumsum(steps.ended, axis=0) + playing.over
    counted = (ends - steps.ended == 0).astype(jnp.float32)  # (T, B)
    last = counted * steps.ended
    success, score = (steps.result.metrics[name] for name in ("success", "score"))
    before = playing.scores
    scores = Scores(
        success=before.success + jnp.sum(last * success, axis=0),
        success_ever=jnp.maximum(before.success_ever, jnp.max(counted * success, axis=0)),
        score=before.score + jnp.sum(last * score, axis=0),
        reward=before.reward + jnp.sum(counted * steps.result.reward, axis=0),
    )
    return playing._replace(over=ends[-1] > 0, scores=scores)


def _choose(first: Bool[Array, ""], one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)
