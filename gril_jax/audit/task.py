"""A task as an audit needs it: its stages, and where its objects can be."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray


@runtime_checkable
class StagedTask(Protocol):
    """A task in stages, as `gril_jax.envs.stages.Stages` has them; lengths are world units."""

    stages: Sequence[Any]  # in their order; each says whether it holds, and places its objects
    faults: Sequence[Any]
    movable: tuple[int, ...]
    robots: tuple[int, ...]
    sizes: Any
    half_extent: float

    def progress(self, center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Any:
        """True progress, from 0 to 1."""

    def limit(self, size: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
        """The centres' greatest distance from the middle: |x|, |y| at most this."""

    def arrange(
        self, key: PRNGKeyArray, center: Float[Array, "N 2"], size: Float[Array, "N 2"],
        wanted: Bool[Array, "K"],
    ) -> Float[Array, "N 2"]:  # fmt: skip
        """Centres at which exactly the wanted stages hold, if there are such."""

    def astray(
        self, key: PRNGKeyArray, stage: Any, center: Float[Array, "N 2"], size: Float[Array, "N 2"]
    ) -> Float[Array, "N 2"]:
        """Centres with the objects of a stage anywhere that it does not hold."""

    def scatter(
        self, key: PRNGKeyArray, index: Int[Array, ""] | int, center: Float[Array, "N 2"],
        size: Float[Array, "N 2"],
    ) -> Float[Array, "N 2"]:  # fmt: skip
        """Centres with one movable object anywhere."""
