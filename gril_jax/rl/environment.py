"""A task as the algorithms need it."""

from typing import Any, Protocol, runtime_checkable

from jaxtyping import Array, Float, PRNGKeyArray


@runtime_checkable
class Environment(Protocol):
    """A task as pure functions of its state, which has at least `obs`, `objects`, `moved`,
    `reward`, `done` and `metrics` (see `gril_jax.envs.base.State`)."""

    action_size: int
    episode_length: int  # control steps

    def reset(self, key: PRNGKeyArray) -> Any: ...

    def step(self, state: Any, action: Float[Array, "A"]) -> Any: ...
