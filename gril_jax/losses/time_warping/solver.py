"""The softly best alignment's value and its derivatives, for `soft_dtw`.

The recursion itself is in `recursion`. Here it becomes a function with derivatives of
its own, and vmap makes more lanes of it. Arguments are the fields of a `Problem`; then
`implementation`, which is "scan" for that recursion or a function that takes its place (the GPU's
kernel).
"""

import functools

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero

from .recursion import recursion, strip_height


@functools.partial(jax.custom_jvp, nondiff_argnums=(4,))
def best_value(cost, gamma, rows, columns, implementation):
    """The soft minimum over alignments of each pair; fields of a `Problem` first."""
    return _batched(implementation, False)(cost, gamma, rows, columns)[0]


def _best_value_rule(implementation, primals, tangents):
    """Derivative along the expected alignment (envelope theorem). Unused tangents cost nothing."""
    cost_tangent, gamma_tangent, *_ = tangents
    value, alignment = best_value_and_alignment(*primals, implementation)
    tangent = jnp.zeros_like(value)
    if not isinstance(cost_tangent, SymbolicZero):
        tangent += jnp.sum(alignment * cost_tangent, axis=(1, 2))
    if not isinstance(gamma_tangent, SymbolicZero):
        tangent += _slope_by_gamma(*primals) * gamma_tangent
    return value, tangent


best_value.defjvp(_best_value_rule, symbolic_zeros=True)


@jax.jit
def _slope_by_gamma(cost, gamma, rows, columns):
    """The derivative by gamma, carried along with the sums: minus the entropy of the alignments.

    (value - <alignment, cost>) / gamma is the same, but a small difference of large numbers: in
    float32 it is wrong by per cents where gamma is a ten-thousandth of the value.
    """

    def value(gamma):
        return scan(cost, gamma, rows, columns, alignment=False)[0]

    return jax.jvp(value, (gamma,), (jnp.ones_like(gamma),))[1]


@functools.partial(jax.custom_jvp, nondiff_argnums=(4,))
def best_value_and_alignment(cost, gamma, rows, columns, implementation):
    """`best_value` and its derivative by the cost, from one forward and one backward pass."""
    return _batched(implementation, True)(cost, gamma, rows, columns)


@best_value_and_alignment.defjvp
def _best_value_and_alignment_rule(implementation, primals, tangents):
    cost, gamma, rows, columns = primals

    def both(cost, gamma):
        return scan(cost, gamma, rows, columns, alignment=True)

    return jax.jvp(both, (cost, gamma), tangents[:2])


@functools.cache
def _batched(implementation, alignment):
    """The compiled recursion, batched: vmap adds lanes to it instead of another loop."""
    run = scan if implementation == "scan" else implementation
    run = custom_vmap(jax.jit(functools.partial(run, alignment=alignment)))

    @run.def_vmap
    def more_lanes(size, is_batched, *arguments):
        merged = []
        for x, batched in zip(arguments, is_batched, strict=True):
            x = x if batched else jnp.broadcast_to(x, (size, *x.shape))
            merged.append(x.reshape(x.shape[0] * x.shape[1], *x.shape[2:]))
        out = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), run(*merged))
        return out, jax.tree.map(lambda _: True, out)

    return run


def scan(cost, gamma, rows, columns, *, alignment):
    """The recursion in the loop order of the platform it is compiled for."""
    pairs, height, _ = cost.shape
    if pairs == 0:
        return gamma, cost if alignment else None

    def on(platform):
        strip = strip_height(pairs, height, platform=platform)
        return functools.partial(recursion, height=strip, alignment=alignment)

    arguments = cost, gamma, rows, columns
    return jax.lax.platform_dependent(*arguments, cpu=on("cpu"), default=on("other"))
