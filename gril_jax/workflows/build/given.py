"""What a policy's learner is given beside its reward: its assistance, in words.

- Task starts only: training episodes begin at the task's own initial states, and the policy sees
  poses and velocities.
- Visited-state resets: some begin at states that the policy has visited.
- Video-state resets: some begin at states that the videos show.
- Expert-state resets: some begin at states that an expert of the task chose, or the policy sees a
  test of the goal.
"""

from collections.abc import Iterable
from typing import NamedTuple

from gril_jax import envs
from gril_jax.config import RunConfig


class Given(NamedTuple):
    """All that a learner is given."""

    assistance: str
    starts: str
    observation: str
    reward: str
    ends: str

    def __str__(self) -> str:
        return (
            f"{self.assistance}: training episodes begin at {self.starts}; the policy sees "
            f"{self.observation}; the reward is {self.reward}; episodes end {self.ends}"
        )


def given(config: RunConfig) -> Given:
    """The assistance that the learner of this configuration gets."""
    task, chosen = envs.spec(config.env.name), config.env
    options = envs.options(chosen.name)
    own = f"the task's {chosen.variant.capitalize()} starts" if "variant" in options else ""
    starts = own or "the task's own starts"
    varied = chosen.varied_starts if task.varied else 0.0
    if varied:
        starts = f"{starts}, {100 * varied:.0f} % of them varied ({task.varied})"
    hints = [task.hints[kind] for kind in ("", chosen.observation) if kind in task.hints]
    assistance, resets = _resets(config)
    assistance = "expert-state resets" if varied or hints else assistance
    if getattr(config, config.run.algorithm).observe_gradient:
        hints.append("the gradient of the learned reward")
    seen = "the task's own observation" if chosen.is_own else "poses and velocities"
    seen = f"{seen}, and {', '.join(hints)}" if hints else seen
    ends = "by time, or where the task ends them" if chosen.is_own else "by time"
    return Given(assistance, f"{starts}{resets}", seen, _reward(config, task), ends)


def _resets(config: RunConfig) -> tuple[str, str]:
    """The assistance by states that training resets to, and in words which these are."""
    section = getattr(config, config.run.algorithm)
    assistance, said = "task starts only", ""
    for kind, states in (("visited", "visited states"), ("video", "states of the videos")):
        if share := getattr(section, f"{kind}_state_resets"):
            assistance = f"{kind}-state resets"
            said += f", {100 * share:.0f} % of them at first at {states}"
    return assistance, said


def _reward(config: RunConfig, task: envs.TaskSpec) -> str:
    if config.run.reward_source is not None:
        return f"that of {config.run.reward_source}"
    own = f"the task's own ({config.env.reward or task.rewards[0]})" if task.rewards else "its own"
    return {
        "learned": "learned from videos",
        "environmental": own,
        "stages": f"learned from videos, in its stages{_acting(config)}",
        "shaped": f"{own}, with one learned from videos as a potential",
    }.get(config.run.reward_form, config.run.reward)


def _acting(config: RunConfig) -> str:
    """Who acts in the stages, in words; "" if it is one network."""
    count = config.sub_policies
    return f", each with a sub-policy of its own ({count})" if count > 1 else ""


def of_all(configs: Iterable[RunConfig]) -> str:
    """The assistance of several learners in one sentence, without their rewards."""
    each = dict.fromkeys(given(config)._replace(reward="the row's") for config in configs)
    return f"Assistance: {'; or: '.join(map(str, each))}." if each else ""
