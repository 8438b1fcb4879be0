"""A learned reward with everything needed to use it; `gril_jax.export.reward_file` saves it.

    learned = load_reward("reward.npz")
    r = learned(center, size, active)                   # of one state: jit, vmap, grad
    memory = learned.init(center, size)                 # of a rollout, at an episode's first frame
    memory, r = learned.step(memory, center, size)      # each frame after it: the body of a scan

A `LearnedReward` is a pytree whose leaves are its parameters, so it may be an argument of a
compiled function, or a constant in one. Shapes use N for objects and T for frames; positions and
sizes are in the world units that the reward was trained in (`gril_jax.boxes_from_pixels`).

Detectors lose objects: the box then holds NaN or an infinite number. In a rollout such an object
stays where it was last seen. In the reward of one state it counts as not present, as does one not
yet seen and one whose box is 0 wide and high. Where no object is left, it is `NOTHING_SEEN`.
"""

import dataclasses
import json
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from gril_jax import graphs
from gril_jax.encoders.encoder import AnyConfig, PixelConfig
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs import activity
from gril_jax.graphs.activity_rule import PAPER, ActivityRule
from gril_jax.reward.latent_goal import RewardParams, latent_goal_reward
from gril_jax.types import checked

NOTHING_SEEN = -2.0
"""The reward where no object has a finite box: twice the distance at which demonstrations begin."""

_SHORTEST = 64  # frames that a recording is padded to
_FAR = 20.0  # half extents of the reward's scenes: boxes beyond that are in other units


class Memory(NamedTuple):
    """Memory of an episode, to be reset when an episode begins."""

    activity: activity.Memory
    center: Float[Array, "N 2"]  # where each object was last seen
    size: Float[Array, "N 2"]


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["params"],
    meta_fields=["config", "classes", "robots", "objects", "activity", "description"],
)
@dataclasses.dataclass(frozen=True, eq=False, repr=False)  # by identity: `jax.jit` hashes it
class LearnedReward:
    """The reward of Eq. 7 with its encoder's choices, its classes and its activity rule (Eq. 4)."""

    params: RewardParams
    config: AnyConfig
    classes: tuple[str, ...]
    """Class names; a label is an index into them."""
    robots: tuple[str, ...] = ()
    """The classes that belong to the robot."""
    objects: tuple[str, ...] = ()
    """Class of each object of the usual scene, in order; gives labels and robot flags by
    default."""
    activity: ActivityRule = PAPER
    """Rule by which an object counts as moved, as in training."""
    description: str = "{}"
    """The file's description, a JSON text: units, training, versions."""

    def __post_init__(self):
        for field in ("robots", "objects"):
            for name in getattr(self, field):
                if name not in self.classes:
                    raise ConfigError(
                        f"{field} names {name!r}; it must be one of the classes "
                        f"{', '.join(self.classes)}."
                    )

    def __repr__(self) -> str:
        of = ", ".join(self.objects) or f"any objects of {len(self.classes)} classes"
        return f"<learned reward of {of}>"

    @property
    def about(self) -> dict[str, Any]:
        """The file's description: units, training, versions."""
        return json.loads(self.description)

    @property
    def label(self) -> Int[Array, "N"]:
        """Index of each object's class, for the usual scene."""
        return jnp.array([self.classes.index(name) for name in self.objects], jnp.int32)

    @property
    def is_robot(self) -> Bool[Array, "N"]:
        """True for the objects of the usual scene that belong to the robot."""
        return jnp.array([name in self.robots for name in self.objects], bool)

    @checked
    def for_objects(self, objects: Sequence[str]) -> "LearnedReward":
        """The same reward for another scene: the class of each of its objects, in order.

        Raises:
          ConfigError: a name is not one of `classes`.
        """
        return dataclasses.replace(self, objects=tuple(objects))

    @checked
    def save(self, path: Any, *, overwrite: bool = False) -> None:
        """Writes the reward to a new file, which `gril_jax.load_reward` reads.

        Raises:
          RewardFileError: the file exists, its folder is missing, full or not writable, or a
            parameter is not finite.
        """
        # A file is the host's: nothing else here knows of any.
        from gril_jax.export.reward_file import save_learned

        save_learned(path, self, overwrite=overwrite)

    @checked
    def __call__(
        self,
        center: Float[Array, "..."],
        size: Float[Array, "..."],
        active: Bool[Array, "..."],
        *,
        label: Int[ArrayLike, "..."] | None = None,
        is_robot: Bool[ArrayLike, "..."] | None = None,
        present: Bool[ArrayLike, "..."] | None = None,
    ) -> Float[Array, ""]:
        """The reward of one state: 0 at the goal, and at most 0 unless it predicts progress; never
        NaN, whatever boxes hold.

        Args:
          center: box centres (N, 2), world units.
          size: box widths and heights, of the same shape.
          active: (N,) objects that have moved since the episode began (`gril_jax.graphs.activity`).
          label: (N,) class indices; those of `objects` if left out.
          is_robot: (N,) robot flags; those of `label` by `robots` if left out.
          present: (N,) False for padding; if left out, of boxes whose width and height are 0.

        Raises:
          ShapeError: the arrays do not belong to the same objects.
          ConfigError: the encoder takes pictures (`of_frame`), labels are missing, a label is not
            an index into `classes`, or known boxes lie so far out that they must be in pixels.
        """
        self._check_boxes()
        center, size, active = (jnp.asarray(x) for x in (center, size, active))
        nodes = self._check(center, size)
        label, is_robot = self._scene(label, is_robot)
        given = dict(active=active, label=label, is_robot=is_robot)
        if present is not None:
            given["present"] = jnp.asarray(present)
        for name, flags in given.items():
            if flags.shape != (nodes,):
                raise ShapeError(
                    f"{name} has shape {flags.shape} but center has shape {center.shape}; {name} "
                    f"must have shape ({nodes},), one value for each object."
                )
        return _compiled(_of_state, self, center, size, given)

    @checked
    def of_frame(self, frame: Float[Array, "height width 3"]) -> Float[Array, ""]:
        """The reward of one picture, RGB in [0, 1], for a pixel encoder.

        Raises:
          ConfigError: the encoder takes boxes, not pictures.
          ShapeError: the frame is not floating, or not of shape (height, width, 3).
        """
        if not isinstance(self.config, PixelConfig):
            raise ConfigError(
                f"the encoder is a {type(self.config).__name__}, which takes boxes: call the "
                "reward itself, or its step."
            )
        frame = jnp.asarray(frame)
        if frame.ndim != 3:
            raise ShapeError(f"frame has shape {frame.shape}; it must be (height, width, 3).")
        return self._value(frame)

    @checked
    def init(self, center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Memory:
        """Memory of an episode's first frame: nothing has moved.

        Frames before the first count as the first. `step` is for the frames after it; the first
        frame's own reward is `of_memory`.

        Raises:
          ShapeError: center and size are not both (N, 2).
          ConfigError: the encoder takes pictures (`of_frame`).
        """
        self._check_boxes()
        center, size = jnp.asarray(center), jnp.asarray(size)
        self._check(center, size)
        return Memory(self.activity.init(center), center, size)

    @checked
    def step(
        self,
        memory: Memory,
        center: Float[Array, "N 2"],
        size: Float[Array, "N 2"],
        *,
        label: Int[ArrayLike, "..."] | None = None,
        is_robot: Bool[ArrayLike, "..."] | None = None,
        present: Bool[ArrayLike, "..."] | None = None,
    ) -> tuple[Memory, Float[Array, ""]]:
        """The memory after the next frame, and this frame's reward.

        `jax.lax.scan(lambda m, x: learned.step(m, *x), memory, (centers, sizes))` does a rollout.

        Args:
          memory: from `init` or the previous `step`; `memory.activity.active` are the bits.
          center, size: the boxes of this frame, world units; one that is not finite is that of the
            frame before.
          label, is_robot, present: as for the reward of a state.

        Raises:
          ShapeError: the arrays do not belong to the memory's objects.
        """
        center, size = jnp.asarray(center), jnp.asarray(size)
        self._check(center, size)
        if center.shape != memory.center.shape:
            raise ShapeError(
                f"center has shape {center.shape} but the memory was made for "
                f"{memory.center.shape}; call init with this scene's first frame."
            )
        label, is_robot = self._scene(label, is_robot)
        given = dict(label=label, is_robot=is_robot, present=present)
        return _compiled(_next, self, memory, center, size, given)

    @checked
    def of_memory(self, memory: Memory, **given: Any) -> Float[Array, ""]:
        """The reward of the last frame in a memory; `given` as for the reward of one state."""
        return self(memory.center, memory.size, memory.activity.active, **given)

    @checked
    def trajectory(
        self,
        center: Float[ArrayLike, "T N 2"],
        size: Float[ArrayLike, "..."],
        *,
        label: Int[ArrayLike, "..."] | None = None,
        is_robot: Bool[ArrayLike, "..."] | None = None,
        present: Bool[ArrayLike, "..."] | None = None,
    ) -> Float[Array, "T"]:
        """The reward of every frame of one recording.

        It is compiled once for recordings of up to 64 frames, once more up to 128, and so on.

        Args:
          center, size: the boxes of all frames, world units; see `step`.
          label, is_robot, present: as for the reward of one state.

        Raises:
          ShapeError: there is no frame, or the arrays do not belong to the same objects.
        """
        center, size = jnp.asarray(center), jnp.asarray(size)
        if center.ndim != 3 or not len(center) or size.shape != center.shape:
            raise ShapeError(
                f"center has shape {center.shape} and size {size.shape}; both must be (T, N, 2), "
                "with one frame or more."
            )
        self._check_boxes()
        self._check_units(center, size)
        label, is_robot = self._scene(label, is_robot)
        given = dict(label=label, is_robot=is_robot, present=present)
        if _traced(self, center, size, given):
            return _along(self, center, size, given)
        # What follows a frame does not change its reward.
        frames = range(max(_SHORTEST, 1 << (len(center) - 1).bit_length()))
        at = [min(frame, len(center) - 1) for frame in frames]
        padded = [x[at] for x in jax.device_get((center, size))]  # on the host: nothing compiles
        rewards = jax.device_get(_compiled(_along, self, *padded, given))
        return jnp.asarray(rewards[: len(center)])

    def _value(self, seen):
        return latent_goal_reward(self.params, seen, self.config)

    def _check_boxes(self):
        if isinstance(self.config, PixelConfig):
            raise ConfigError("the encoder is a PixelConfig, which takes pictures: call of_frame.")

    def _check(self, center, size):
        """Checks shapes and units; returns the number of objects."""
        if center.ndim != 2 or center.shape[-1] != 2:
            raise ShapeError(f"center has shape {center.shape}; it must be (N, 2).")
        if size.shape != center.shape:
            raise ShapeError(
                f"size has shape {size.shape} but center has shape {center.shape}; they must be "
                "equal."
            )
        self._check_units(center, size)
        return len(center)

    def _check_units(self, center, size):
        """Refuses known boxes that lie so far out that they must be in pixels."""
        half_extent = self.about.get("half_extent")
        if half_extent is None or any(isinstance(x, jax.core.Tracer) for x in (center, size)):
            return
        known = [abs(x) for x in jax.device_get((center, size))]  # on the host: nothing compiles
        furthest = max(x[x < float("inf")].max(initial=0.0) for x in known)
        if furthest > _FAR * half_extent:
            raise ConfigError(
                f"center or size holds {furthest:g}, but the reward's scenes reach {half_extent:g} "
                "world units to each side; convert pixels with gril_jax.boxes_from_pixels."
            )

    def _scene(self, label, is_robot):
        if label is None:
            if not self.objects:
                raise ConfigError(
                    "label is missing and the reward names no objects; give label, or use "
                    "for_objects with the class of each object."
                )
            label = self.label
        elif not isinstance(label, jax.core.Tracer):
            _check_labels(label, self.classes)
        label = jnp.asarray(label)
        if is_robot is None:
            is_robot = jnp.array([name in self.robots for name in self.classes], bool)[label]
        return label, jnp.asarray(is_robot)


def _of_state(learned, center, size, given):
    finite, known = _finite(center, size), "present" in given
    # As in `scene_graph`: so the reward was learned.
    present = given["present"] if known else (size != 0).any(axis=-1)
    label, is_robot, active = given["label"], given["is_robot"], given["active"]
    seen = present & finite
    lost = present & ~finite if known else ~seen
    center, size = (jnp.where(finite[:, None], x, 0.0) for x in (center, size))
    value = learned._value(graphs.scene_graph(center, size, label, is_robot, active, seen))
    counts = jnp.asarray(True) if getattr(learned.config, "pool_robot", True) else ~is_robot
    nothing = jnp.any(lost & counts) & ~jnp.any(seen & counts)
    return jnp.where(nothing, NOTHING_SEEN, value)


def _next(learned, memory, center, size, given):
    # Left out, a lost object could raise the reward: its way to the goal would not count.
    seen = _finite(center, size)[:, None]
    center = jnp.where(seen, center, memory.center)
    size = jnp.where(seen, size, memory.size)
    memory = Memory(learned.activity.step(memory.activity, center, size)[0], center, size)
    return memory, learned.of_memory(memory, **given)


def _along(learned, center, size, given):
    memory = learned.init(center[0], size[0])
    frame = lambda memory, boxes: learned.step(memory, *boxes, **given)  # noqa: E731
    _, later = jax.lax.scan(frame, memory, (center[1:], size[1:]))
    return jnp.concatenate([learned.of_memory(memory, **given)[None], later])


_PROGRAMS = {part: jax.jit(part) for part in (_of_state, _next, _along)}


def _compiled(part, *args):
    """The result of a part, which is a program of its own outside of a user's compiled function."""
    return (part if _traced(*args) else _PROGRAMS[part])(*args)


def _traced(*trees):
    return any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(trees))


def _finite(center, size):
    return jnp.isfinite(center).all(axis=-1) & jnp.isfinite(size).all(axis=-1)


def _check_labels(label, classes):
    with jax.ensure_compile_time_eval():
        known = jax.device_get(jnp.asarray(label))
    low, high = int(known.min(initial=0)), int(known.max(initial=0))
    if low < 0 or high >= len(classes):
        raise ConfigError(
            f"label holds {low if low < 0 else high}; it must lie in 0 to {len(classes) - 1}, the "
            f"reward's {len(classes)} classes."
        )
