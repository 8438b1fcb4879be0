"""ClusterColour and ClusterShape: sort the blocks into heaps. MakeLine: put them on one line.

In a heap a block is right if a < b - 2 a^2, where a is its distance from the mean of its class, and
b that from the nearest mean of another. A line is the longest run of blocks within 0.18 of a line
through two of them, neighbours at most 0.42 apart; a tight clump of two by two is one, too: the
rule is the original's.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.stages import Stage, Stages, free_place
from jaxtyping import Array, Bool, Float, Int

from .plan import Block, Kinds, Plan, Scene, colours, each_once, shapes
from .task import SuiteTask

_MOST = 10
_APART = 0.7  # arena units between heaps that are put somewhere
_HEAP = 0.26  # from its first block to the others, each way: they are beside it


def right(
    blocks: Float[Array, "B 2"], kind: Int[Array, "B"], there: Bool[Array, "B"]
) -> Bool[Array, "B"]:
    """True for blocks that are nearer to their own class than to any other, and are there."""
    member = (kind[:, None] == jnp.arange(4)) & there[:, None]
    count = member.sum(axis=0)
    middle = jnp.where(member.T[..., None], blocks, 0.0).sum(axis=1)
    middle = middle / jnp.maximum(count, 1)[:, None]
    away = jnp.sqrt(jnp.sum((blocks[:, None] - middle) ** 2, axis=-1) + 1e-14)
    own = jnp.min(jnp.where(member, away, jnp.inf), axis=1)
    other = jnp.min(jnp.where(member | (count == 0), jnp.inf, away), axis=1)
    return there & (own < other - 2.0 * own**2)


class _Cluster(SuiteTask):
    """The base of both tasks."""

    length = 240

    def kind(self, shape: Int[Array, "B"], colour: Int[Array, "B"]) -> Int[Array, "B"]:
        """The class of each block, from 0 to 3."""
        raise NotImplementedError

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Each colour and each shape at least once; in CountPlus 7 to 10 blocks."""
        slots = len(kinds.shape)
        count = jax.random.randint(keys(), (), 7, _MOST + 1) if self.varies("count") else slots
        if self.varies("color"):
            kinds = kinds._replace(colour=each_once(keys(), colours(keys(), slots), count))
        if self.varies("shape"):
            kinds = kinds._replace(shape=each_once(keys(), shapes(keys(), slots), count))
        return kinds.first(count) if self.varies("count") else kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """max(0, share of right blocks - 0.75) / 0.25."""
        good = right(scene.blocks, self.kind(scene.shape, scene.colour), scene.there)
        # In whole blocks: of eight, six are a share of exactly three quarters.
        beyond = 4 * good.sum() - 3 * scene.there.sum()
        return jnp.maximum(beyond, 0) / jnp.maximum(scene.there.sum(), 1).astype(jnp.float32)

    def _stages(self) -> Stages:
        known = self.plan.kinds()
        kind = np.asarray(self.kind(known.shape, known.colour))
        rows = np.array([self._order.block(b) for b in range(len(kind))])
        movable = tuple(sorted(rows.tolist()))
        there = jnp.ones(len(kind), bool)

        def together(k: int) -> Stage:
            members = tuple(rows[kind == k].tolist())

            def holds(center, size):
                good = right(center[rows], jnp.asarray(kind), there)
                return good[kind == k].all()

            def place(key, center, size):
                keys = jax.random.split(key, len(members))
                limit = self.arena - _HEAP
                others = [center[rows[kind == j]].mean(axis=0) for j in {*kind.tolist()} - {k}]
                middles = jnp.stack(others)

                def apart(c):
                    return (jnp.linalg.norm(c[members[0]] - middles, axis=1) > _APART).all()

                center = free_place(
                    keys[0], members[0], center, size, low=jnp.full(2, -limit),
                    high=jnp.full(2, limit), others=movable, allowed=apart,
                )  # fmt: skip
                first = center[members[0]]
                for one, key_one in zip(members[1:], keys[1:], strict=True):
                    center = free_place(
                        key_one, one, center, size, low=first - _HEAP, high=first + _HEAP,
                        others=movable,
                    )  # fmt: skip
                return center

            name = " and ".join(
                sorted({self.plan.blocks[b].name for b in np.flatnonzero(kind == k)})
            )
            return Stage(f"{name} together", members, holds, place)

        several = [k for k in range(4) if (kind == k).sum() > 1]
        return self._staged([together(k) for k in several], movable)


class ClusterColour(_Cluster):
    """The ClusterColour task; see the module docstring."""

    plan = Plan(
        (0.71692, -0.34374, 0.83693),
        (
            Block("blue circle", (-0.5147, 0.14149, -0.38871)),
            Block("blue star", (-0.1347, -0.71414, 1.0533)),
            Block("blue square", (-0.74247, -0.097592, 1.1571)),
            Block("green pentagon", (-0.077363, -0.42964, -0.64379)),
            Block("green pentagon", (0.51978, 0.1853, -1.1762)),
            Block("red square", (-0.5278, -0.21642, 2.9356)),
            Block("yellow star", (-0.54039, 0.48292, 0.072818)),
            Block("yellow pentagon", (-0.16761, 0.64303, -2.3255)),
        ),
        slots=_MOST,
    )

    def kind(self, shape, colour):
        """The colour."""
        return colour


class ClusterShape(_Cluster):
    """The ClusterShape task; see the module docstring."""

    plan = Plan(
        (0.286, -0.202, -1.878),
        (
            Block("yellow square", (-0.414, 0.297, -1.731)),
            Block("blue pentagon", (0.068, 0.705, 2.184)),
            Block("red pentagon", (0.821, 0.220, 0.650)),
            Block("red pentagon", (-0.461, -0.749, -2.673)),
            Block("green circle", (0.867, -0.149, -2.215)),
            Block("yellow star", (-0.785, -0.140, -0.405)),
            Block("blue star", (-0.305, -0.226, 1.341)),
            Block("green circle", (0.758, -0.708, -2.140)),
        ),
        slots=_MOST,
    )

    def kind(self, shape, colour):
        """The shape."""
        return shape


_ASIDE, _GAP = 0.18, 0.42  # 1.5 and 3.5 block sizes
_PITCH = 0.26  # between blocks that are put on a line


def longest(blocks: Float[Array, "B 2"], there: Bool[Array, "B"]) -> Int[Array, ""]:
    """The number of blocks on the longest line."""
    count = len(blocks)
    first, second = np.triu_indices(count, 1)
    along = blocks[second] - blocks[first]
    along = along / jnp.sqrt(jnp.sum(along**2, axis=1, keepdims=True) + 1e-12)
    way = blocks - blocks[first][:, None]  # (pairs, B, 2)
    reach = jnp.sum(way * along[:, None], axis=-1)
    aside = jnp.abs(way[..., 0] * along[:, None, 1] - way[..., 1] * along[:, None, 0])
    reach = jnp.sort(jnp.where((aside <= _ASIDE) & there, reach, jnp.inf), axis=1)
    run, best = jnp.isfinite(reach[:, 0]).astype(jnp.int32), jnp.ones((), jnp.int32)
    for k in range(1, count):
        here = jnp.isfinite(reach[:, k])
        linked = here & (jnp.where(here, reach[:, k], 0.0) - reach[:, k - 1] <= _GAP)
        run = jnp.where(linked, run + 1, here.astype(jnp.int32))
        best = jnp.maximum(best, jnp.max(jnp.where(there[first] & there[second], run, 1)))
    return best


class MakeLine(SuiteTask):
    """The MakeLine task; see the module docstring."""

    length = 180
    plan = Plan(
        (0.702, -0.255, 0.347),
        (
            Block("blue star", (0.790, -0.820, -0.721)),
            Block("yellow circle", (-0.177, 0.383, -1.733)),
            Block("red star", (-0.051, -0.128, 2.696)),
            Block("green pentagon", (-0.292, -0.745, -0.159)),
        ),
    )

    def draw(self, keys, kinds: Kinds) -> Kinds:
        """Any colours, any shapes; in CountPlus 3 or 4 blocks."""
        if self.varies("color"):
            kinds = kinds._replace(colour=colours(keys(), 4))
        if self.varies("shape"):
            kinds = kinds._replace(shape=shapes(keys(), 4))
        return kinds.first(jax.random.randint(keys(), (), 3, 5)) if self.varies("count") else kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """max(0, L - m) / (n - m)."""
        n = scene.there.sum()
        m = jnp.maximum(n - 2, 2)
        beyond = jnp.maximum(longest(scene.blocks, scene.there) - m, 0)
        return beyond / (n - m).astype(jnp.float32)

    def _stages(self) -> Stages:
        rows = tuple(range(1, 5))

        def holds(center, size):
            return longest(center[jnp.array(rows)], jnp.ones(4, bool)) == 4

        def place(key, center, size):
            key_place, key_angle, key_order = jax.random.split(key, 3)
            limit = self.arena - 1.5 * _PITCH - 0.16
            middle = jax.random.uniform(key_place, (2,), minval=-limit, maxval=limit)
            angle = jax.random.uniform(key_angle, (), maxval=jnp.pi)
            along = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
            order = jax.random.permutation(key_order, jnp.array(rows))
            steps = _PITCH * (jnp.arange(4) - 1.5)
            return center.at[order].set(middle + steps[:, None] * along)

        stage = Stage("all blocks in a line", rows, holds, place)
        return self._staged([stage], rows)
