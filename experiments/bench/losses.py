"""The losses beside what others offer, value plus gradient.

    gril bench losses                   a few minutes on 2 CPU cores

Times are medians in milliseconds, and a ratio above 1 says how many times longer, or how much more
memory, the other form takes. Peers that are not installed are named under `not_installed`.
"""

import statistics
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gril_jax.losses import expected_alignment, mean_cycle_consistency, soft_dtw_between
from gril_jax.runs.progress import Progress

from .frame import median_ms, ratios, rounded, staged, without_cache

try:
    from ott.geometry import costs as ott_costs
except ImportError:
    ott_costs = None

_SHAPES = [(64, 64), (32, 128), (16, 256)]  # pairs, frames of both sequences
_GPU_SHAPES = [(64, 64), (512, 256)]
_FEATURES = 32
_GAMMA = 0.1
_REPEATS = 15  # timed calls of each form
_SIZE = (8, 32, 32)  # videos, frames, width of the latent
_COMPILATIONS = 3  # of each cycle-consistency, whose median counts


def main(
    shapes: Sequence[tuple[int, int]] | None = None, repeats: int = _REPEATS
) -> dict[str, Any]:
    """The figures of soft-DTW at each size, and of cycle-consistency."""
    gpu = jax.default_backend() == "gpu"
    shapes = (_GPU_SHAPES if gpu else _SHAPES) if shapes is None else shapes
    cases: list[dict[str, Any]] = []
    with Progress() as progress:
        phase = progress.phase("losses", total=len(shapes) + 1, unit="cases", compiles=False)
        for shape in shapes:
            cases.append(soft_dtw(*shape, repeats, gpu=gpu))
            phase.update(len(cases))
        cycles = cycle_consistency(repeats)
        phase.update(len(shapes) + 1)
    return {"not_installed": not_installed(), "soft_dtw": cases, "tcc": cycles}


def not_installed() -> list[str]:
    """The packages to be compared with that are missing, as pip calls them."""
    return ["ott-jax"] if ott_costs is None else []


def soft_dtw(pairs: int, frames: int, repeats: int, *, gpu: bool) -> dict[str, Any]:
    """Soft-DTW from features: time, temporary memory and the float32 gradient's error."""
    rng = np.random.default_rng(0)
    query, other = 0.3 * rng.normal(size=(2, pairs, frames, _FEATURES)).astype(np.float32)
    ours = partial(soft_dtw_between, gamma=_GAMMA)
    programs = {"ours": ours} | ({"scan": partial(ours, implementation="scan")} if gpu else {})
    if ott_costs is not None:
        programs["ott"] = jax.vmap(ott_costs.SoftDTW(gamma=_GAMMA))
    forms, memory = {}, {}
    arguments = jnp.asarray(query), jnp.asarray(other)
    for name, program in programs.items():

        def total(query, other, program=program):
            values = program(query, other)
            return jnp.sum(values), values

        both = jax.value_and_grad(total, argnums=(0, 1), has_aux=True)
        compiled = jax.jit(both).lower(*arguments).compile()
        memory[name] = round(compiled.memory_analysis().temp_size_in_bytes / 1e6, 2)
        forms[name] = partial(compiled, *arguments)
    times = median_ms(forms, repeats, pause_s=0.01)
    case = {"pairs": pairs, "frames": frames, "ms": times, "temporary_mb": memory}
    case |= {"times_as_slow": ratios(times, "ours"), "times_the_memory": ratios(memory, "ours")}
    return case if gpu else case | {"gradient_error": _gradient_errors(query, other)}


def _squares(query, other):
    """Squared distances in float64."""
    query, other = (np.asarray(x, np.float64) for x in (query, other))
    norms = (query**2).sum(-1)[:, :, None] + (other**2).sum(-1)[:, None, :]
    return np.maximum(norms - 2.0 * query @ other.transpose(0, 2, 1), 0.0)


def _gradient_errors(query, other):
    """Largest error of the derivative by the cost, over the first pairs, against float64.

    "textbook" takes exponentials of differences of the stored sums.
    """
    cost = _squares(query[:8], other[:8]).astype(np.float32)
    truth = _textbook(cost.astype(np.float64))
    ours = np.asarray(expected_alignment(jnp.asarray(cost), gamma=_GAMMA))
    found = {"ours": ours, "textbook": _textbook(cost)}
    errors = {name: float(np.abs(e - truth).max()) for name, e in found.items()}
    return errors | {"textbook_over_ours": round(errors["textbook"] / errors["ours"], 1)}


def _textbook(cost):
    """Algorithms 1 and 2 of Cuturi and Blondel (2017), in the cost's own precision."""
    pairs, rows, columns = cost.shape
    gamma, dtype = cost.dtype.type(_GAMMA), cost.dtype
    far = dtype.type(1e10)
    sums = np.full((rows + 2, columns + 2, pairs), far, dtype)
    sums[0, 0] = 0
    padded = np.zeros((rows + 2, columns + 2, pairs), dtype)
    padded[1:-1, 1:-1] = cost.transpose(1, 2, 0)
    for i in range(1, rows + 1):
        for j in range(1, columns + 1):
            before = -np.stack([sums[i - 1, j], sums[i, j - 1], sums[i - 1, j - 1]]) / gamma
            most = before.max(axis=0)
            log_sum = most + np.log(np.exp(before - most).sum(axis=0))
            sums[i, j] = padded[i, j] - gamma * log_sum
    sums[-1, :], sums[:, -1] = -far, -far
    sums[-1, -1] = sums[-2, -2]
    flow = np.zeros_like(sums)
    flow[-1, -1] = 1
    for i in range(rows, 0, -1):
        for j in range(columns, 0, -1):
            for a, b in ((i + 1, j), (i, j + 1), (i + 1, j + 1)):
                weight = np.exp((sums[a, b] - sums[i, j] - padded[a, b]) / gamma)
                flow[i, j] += weight * flow[a, b]
    return flow[1:-1, 1:-1].transpose(2, 0, 1)


def pair_loop(latents: Float[Array, "B T D"], times: Float[Array, "B T"]) -> Float[Array, ""]:
    """The same loss as XIRL publishes it: a loop over the ordered pairs, then one regression."""
    num_videos, num_frames, width = latents.shape

    def similarity(a, b):
        squares = jnp.sum(a * a, axis=1)[:, None] + jnp.sum(b * b, axis=1)
        return (2.0 * a @ b.T - squares) / width

    logits, steps = [], []
    pairs = [(i, j) for i in range(num_videos) for j in range(num_videos) if i != j]
    for i, j in pairs:
        weights = jax.nn.softmax(similarity(latents[i], latents[j]), axis=1)
        logits.append(similarity(weights @ latents[j], latents[i]))
        steps.append(jnp.broadcast_to(times[i], (num_frames, num_frames)))
    weights = jax.nn.softmax(jnp.concatenate(logits), axis=1)
    steps = jnp.concatenate(steps)
    home = jax.nn.one_hot(jnp.tile(jnp.arange(num_frames), len(pairs)), num_frames)
    error = jnp.sum(steps * weights, axis=1) - jnp.sum(steps * home, axis=1)
    return jnp.mean(jnp.square(error))


def cycle_consistency(repeats: int) -> dict[str, Any]:
    """Times and memory of its value and gradient, and the loop's over the others'."""
    losses = {"pair_loop": pair_loop, "mapped": mean_cycle_consistency}
    num_videos, num_frames, width = _SIZE
    times = jnp.tile(jnp.arange(num_frames) / num_frames, (num_videos, 1))
    args = jax.random.normal(jax.random.key(0), _SIZE), times
    compiled, taken = {}, {name: [] for name in losses}
    for _ in range(_COMPILATIONS):
        for name, loss in losses.items():
            # A new function each time: one that has been traced before is not traced again.
            fresh = jax.jit(jax.value_and_grad(partial(loss)))
            with without_cache():
                compiled[name], *seconds = staged(fresh, args, plain=True)
            taken[name].append(seconds)
    calls = {name: partial(program, *args) for name, program in compiled.items()}
    run_ms = median_ms(calls, repeats)
    figures = {}
    for name, program in compiled.items():
        trace_s, compile_s = (statistics.median(x) for x in zip(*taken[name], strict=True))
        temporary_mb = program.memory_analysis().temp_size_in_bytes / 1e6
        found = {"trace_s": trace_s, "compile_s": compile_s, "temporary_mb": temporary_mb}
        figures[name] = {"run_ms": run_ms[name]} | rounded(found, 3)
    peer = figures["pair_loop"]
    over = {
        f"pair_loop_over_{name}": {key: round(peer[key] / own[key], 2) for key in peer}
        for name, own in figures.items()
        if own is not peer
    }
    for name, program in compiled.items():
        figures[name]["value"] = float(program(*args)[0])
    return {"videos": num_videos, "frames": num_frames, "width": width, **figures, **over}
