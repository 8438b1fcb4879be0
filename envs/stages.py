"""A task's stages: predicates over object boxes, and states in which they hold.

A task may offer a `Stages` as its attribute `stages`. A stage holds or not for centres and sizes
alone, so that whoever judges a reward can make up states whose true progress is known; stages may
depend on each other (`required_before`). Shapes use N for the objects of a scene, K for its stages
and F for its faults; lengths are world units. Functions take one scene, and keys are used once.
"""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

Points = Float[Array, "N 2"]
Allowed = Callable[[Points], Bool[Array, ""]]

_CANDIDATES = 64


@dataclasses.dataclass(frozen=True)
class Stage:
    """A stage to be done, or, among the faults, one that must not hold."""

    name: str
    """Description, such as "green star in the region"."""
    moves: tuple[int, ...]
    """Indices of the objects whose motion brings it about."""
    holds: Callable[[Points, Points], Bool[Array, ""]]
    """(centre, size) -> True if it is done."""
    place: Callable[[PRNGKeyArray, Points, Points], Points]
    """(key, centre, size) -> centres at which it holds clearly, only `moves` changed."""
    required_before: tuple[str, ...] = ()
    """Stages that must be done first, all of them declared earlier."""
    within: Callable[[Points, Points], tuple[Float[Array, "2"], Float[Array, "2"]]] | None = None
    """(centre, size) -> corners of a box that has in it every place where the stage holds, for a
    stage of one object; None: it is done by `place` alone."""


@dataclasses.dataclass(frozen=True)
class Stages:
    """A task's stages, in an order in which they can be done.

    Raises:
      ValueError: there is no stage, or one requires a stage that is not declared before it.
    """

    stages: tuple[Stage, ...]
    movable: tuple[int, ...]
    """Objects that the robot can move."""
    half_extent: float
    """Boxes lie within |x|, |y| <= this."""
    score: Callable[["Stages", Points, Points], Float[Array, ""]]
    """(stages, centre, size) -> true progress from 0 to 1, which is success."""
    faults: tuple[Stage, ...] = ()
    """Faults: what the robot can do wrong, stated like the stages."""
    robots: tuple[int, ...] = ()
    """Objects that belong to the robot."""
    sizes: Callable[[Points, Points], Points] = lambda center, size: size
    """(centre, size at the start) -> sizes of the boxes there, differentiable; a lid, for example,
    has another box when it is open."""
    possible: Callable[[Points, Points], Points] = lambda center, size: center
    """(centre, size at the start) -> the nearest centres that mechanics allow; a drawer, for
    example, stays on its rail. Whoever makes up states asks it."""

    def __post_init__(self):
        if not self.stages:
            raise ValueError("stages is empty, but a task has at least one stage")
        known: set[str] = set()
        for stage in self.stages:
            for name in stage.required_before:
                if name not in known:
                    raise ValueError(f"stage {stage.name!r} requires {name!r}, not declared before")
            known.add(stage.name)

    def done(self, center: Points, size: Points) -> Bool[Array, "K"]:
        """The stages that are done; one counts only if all that it requires are done."""
        done: dict[str, Array] = {}
        for stage in self.stages:
            held = stage.holds(center, size)
            for name in stage.required_before:
                held &= done[name]
            done[stage.name] = held
        return jnp.stack([*done.values()])

    def faulty(self, center: Points, size: Points) -> Bool[Array, "F"]:
        """The faults that there are."""
        held = [fault.holds(center, size) for fault in self.faults]
        return jnp.stack(held) if held else jnp.zeros(0, bool)

    def progress(self, center: Points, size: Points) -> Float[Array, ""]:
        """True progress, from 0 to 1."""
        return self.score(self, center, size)

    def arrange(
        self, key: PRNGKeyArray, center: Points, size: Points, wanted: Bool[Array, "K"]
    ) -> Points:
        """A state in which exactly the wanted stages hold, if there is one.

        Objects of other stages stay where they are, unless their stage held there.
        """
        keys = jax.random.split(key, len(self.stages))
        for stage, want, key_stage in zip(self.stages, wanted, keys, strict=True):
            key_in, key_out = jax.random.split(key_stage)
            out = self.astray(key_out, stage, center, size)
            out = jnp.where(stage.holds(center, size), out, center)
            center = jnp.where(want, stage.place(key_in, center, size), out)
        return center

    def fulfil(self, key: PRNGKeyArray, center: Points, size: Points) -> Points:
        """A success: all stages done, each object anywhere where its stage holds, and not only
        where it clearly does. Without a free place for one, the state may be no success."""
        for stage, key_stage in zip(
            self.stages, jax.random.split(key, len(self.stages)), strict=True
        ):
            if stage.within is None:
                center = stage.place(key_stage, center, size)
                continue
            (index,), (low, high) = stage.moves, stage.within(center, size)
            holds = lambda c, stage=stage: stage.holds(c, size)  # noqa: E731
            center = free_place(
                key_stage, index, center, size, low=low, high=high, others=self.movable,
                allowed=holds, possible=self.possible,
            )  # fmt: skip
        return center

    def astray(self, key: PRNGKeyArray, stage: Stage, center: Points, size: Points) -> Points:
        """Moves the objects of a stage anywhere on the plane where it does not hold."""
        allowed = lambda c: ~stage.holds(c, size)  # noqa: E731
        keys = jax.random.split(key, len(stage.moves))
        for index, key_index in zip(stage.moves, keys, strict=True):
            center = self.scatter(key_index, index, center, size, allowed=allowed)
        return center

    def scatter(
        self,
        key: PRNGKeyArray,
        index: Int[Array, ""] | int,
        center: Points,
        size: Points,
        *,
        allowed: Allowed | None = None,
    ) -> Points:
        """Moves one object to any place that it can have, clear of the movable ones if there is
        one."""
        limit = self.limit(size)[index]
        return free_place(
            key, index, center, size, low=-limit, high=limit, others=self.movable, allowed=allowed,
            possible=self.possible,
        )  # fmt: skip

    def limit(self, size: Points) -> Points:
        """The centres' greatest distance from the middle: |x|, |y| at most this."""
        return jnp.maximum(self.half_extent - size / 2, 0.0)


def free_place(
    key: PRNGKeyArray,
    index: Int[Array, ""] | int,
    center: Points,
    size: Points,
    *,
    low: Float[Array, "2"],
    high: Float[Array, "2"],
    others: tuple[int, ...],
    allowed: Allowed | None = None,
    possible: Callable[[Points, Points], Points] | None = None,
) -> Points:
    """Centres with one object moved to a place sampled uniformly between `low` and `high`.

    Each place becomes the nearest that is `possible` (`Stages.possible`). Of 64 of them the first
    is taken that is `allowed`, given the centres with the object moved. There the object, as a disc
    of its mean width, must touch none of the others. If there is none, the allowed place with the
    least overlap is taken. Its own index among the others is passed over.
    """
    places = jax.random.uniform(key, (_CANDIDATES, 2), minval=low, maxval=high)
    moved = jax.vmap(lambda place: center.at[index].set(place))(places)
    if possible is not None:
        moved = jax.vmap(lambda c: possible(c, size))(moved)
        places = moved[:, index]
    radius, which = size.mean(axis=1) / 2, jnp.array(others, jnp.int32)
    apart = jnp.sqrt(jnp.sum((places[:, None] - center[which]) ** 2, axis=2))
    overlap = jnp.where(which == index, 0.0, radius[index] + radius[which] - apart)
    overlap = jnp.max(overlap, axis=1, initial=0.0)
    if allowed is not None:
        overlap = jnp.where(jax.vmap(allowed)(moved), overlap, jnp.inf)
    return moved[jnp.argmin(overlap)]


def put_inside(
    objects: tuple[int, ...],
    region: int,
    *,
    robots: tuple[int, ...],
    half_extent: float,
    names: tuple[str, ...] | None = None,
) -> Stages:
    """Stages that bring the centre of each object into the box of another, in any order.

    Args:
      objects, region, robots: indices of the scene's objects; all others stay where they are.
      names: of the stages; None: "object 2 inside".
    """

    def stage(number: int, index: int) -> Stage:
        def box(center, size):
            return center[region] - size[region] / 2, center[region] + size[region] / 2

        def holds(center, size):
            low, high = box(center, size)
            return ((center[index] > low) & (center[index] < high)).all()

        def place(key, center, size):
            low, high = box(center, size)
            clear = jnp.minimum(size[index], size[region]) / 4  # of the edge: it clearly holds
            return free_place(
                key, index, center, size, low=low + clear, high=high - clear, others=objects
            )

        name = f"object {index} inside" if names is None else names[number]
        return Stage(name, (index,), holds, place, within=box)

    return Stages(
        stages=tuple(stage(number, index) for number, index in enumerate(objects)),
        movable=objects, robots=robots, half_extent=half_extent,
        score=lambda stages, center, size: jnp.mean(stages.done(center, size).astype(jnp.float32)),
    )  # fmt: skip
