"""Routes along which a stick pushes a block, and the control that follows them.

A route is three waypoints: one to get around things, one behind a block, and one to push it to.
`draw` guesses such routes from the geometry of a push; whether one is any good is for the physics
to say (`sampling_planner`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.base import State
from gril_jax.envs.magical.match_regions.task import MatchRegions
from jaxtyping import Array, Float, Int, PRNGKeyArray

__all__ = ["Route", "draw", "follow", "length", "stay"]

_REACHED = 0.07  # arena units from a waypoint at which the next one counts
_PATIENCE = 20  # control steps after which a waypoint is given up


class Route(NamedTuple):
    """Three waypoints, and how far along them the robot is."""

    points: Float[Array, "3 2"]
    at: Int[Array, ""]  # waypoint now headed for; 3 when done
    timer: Int[Array, ""]  # control steps since that one


def stay() -> Route:
    """A route that stands still."""
    zero = jnp.zeros((), jnp.int32)
    return Route(jnp.zeros((3, 2)), zero + 3, zero)


def length(vector: Float[Array, "*B 2"]) -> Float[Array, "*B"]:
    """Length of a vector, with a gradient at none."""
    return jnp.sqrt(jnp.sum(vector**2, axis=-1) + 1e-12)


def follow(env: MatchRegions, route: Route, state: State) -> tuple[Float[Array, "2"], Route]:
    """The action along a route, and the updated route. Either long side may lead."""
    pose = state.data.pose[0]
    away = route.points[jnp.minimum(route.at, 2)] - pose[:2]
    passed = ((length(away) < _REACHED) | (route.timer >= _PATIENCE)) & (route.at < 3)
    at = (route.at + passed).astype(jnp.int32)
    away = route.points[jnp.minimum(at, 2)] - pose[:2]
    angle = jnp.arctan2(-away[0], away[1]) - pose[2]
    side = jnp.where(jnp.cos(angle) >= 0, 1.0, -1.0)
    turn = jnp.arctan2(side * jnp.sin(angle), side * jnp.cos(angle))
    speed = jnp.clip(6.0 * length(away), 0.0, 0.8) * jnp.clip(1.2 - 2 * jnp.abs(turn), 0.0, 1.0)
    action = jnp.stack([side * speed, jnp.clip(6.0 * turn, -2.5, 2.5) / env.turn_gain])
    timer = jnp.where(passed, 0, route.timer + 1).astype(jnp.int32)
    return jnp.where(at < 3, action, 0.0), Route(route.points, at, timer)


def draw(
    env: MatchRegions,
    key: PRNGKeyArray,
    robot: Float[Array, "2"],
    block: Float[Array, "2"],
    slot: Float[Array, "2"],
) -> Route:
    """Samples a route that pushes a block roughly towards a place; 3 in 10 push it elsewhere."""
    keys = jax.random.split(key, 4)
    way = slot - block
    far = length(way)
    strays = jax.random.bernoulli(keys[0], 0.3)
    bend = jnp.where(strays, 1.5, 0.3) * jax.random.normal(keys[1])
    c, s = jnp.cos(bend), jnp.sin(bend)
    way = jnp.stack([c * way[0] - s * way[1], s * way[0] + c * way[1]]) / far
    across = jnp.stack([-way[1], way[0]])
    far = jnp.where(jnp.abs(bend) > 0.8, 0.3, far)

    # A wide stick may also push with an end of its side.
    off, room, share, lateral, *anywhere = jax.random.uniform(keys[2], (6,), minval=-1.0)
    offset = off * max(0.06, env.robot.parts[0].boxes[0].half[0] - 0.08) * across
    behind = block - (0.33 + 0.1 * room) * way + offset
    push = block + ((1.0 + 0.3 * share) * far - 0.19) * way + offset + 0.05 * lateral * across
    around = block + 0.45 * jnp.sign(lateral) * across
    firsts = jnp.stack([robot, around, env.arena * jnp.stack(anywhere)])
    first = firsts[jax.random.randint(keys[3], (), 0, 3)]
    limit = env.arena - 0.06
    zero = jnp.zeros((), jnp.int32)
    return Route(jnp.clip(jnp.stack([first, behind, push]), -limit, limit), zero, zero)
