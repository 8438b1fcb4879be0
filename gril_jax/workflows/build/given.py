"""The ledger of help: what a policy's learner is given beside its reward, as a level and in words.

Level A: the task's own starts alone, poses of robot and objects, episodes that end by time. Level
B: training may also begin at moments that the policy itself has reached. Level V: or where a frame
of the videos shows things. Level C: also what only somebody who knows the goal can give, such as
starts near it, moments of an expert's episodes, or a test of the goal in the observation. A reward
is learned from videos or the task's own, and is named beside the level.
"""

from collections.abc import Iterable
from typing import NamedTuple

from gril_jax import envs
from gril_jax.config import RunConfig


class Given(NamedTuple):
    """All that a learner is given."""

    level: str  # "A", "B", "V" or "C"
    starts: str
    observation: str
    reward: str

    def __str__(self) -> str:
        return (
            f"level {self.level}: training episodes begin at {self.starts}; the policy sees "
            f"{self.observation}; the reward is {self.reward}; episodes end by time"
        )


def given(config: RunConfig) -> Given:
    """The help that the learner of this configuration gets."""
    task, chosen = envs.spec(config.env.name), config.env
    options = envs.options(chosen.name)
    own = f"the task's {chosen.variant.capitalize()} starts" if "variant" in options else ""
    starts = own or "the task's own starts"
    varied = chosen.varied_starts if task.varied else 0.0
    if varied:
        starts = f"{starts}, {100 * varied:.0f} % of them varied ({task.varied})"
    hints = [task.hints[kind] for kind in ("", chosen.observation) if kind in task.hints]
    seen = f"poses and velocities, and {', '.join(hints)}" if hints else "poses and velocities"
    level, chosen_starts = _chosen_starts(config)
    level = "C" if varied or hints else level
    return Given(level, f"{starts}{chosen_starts}", seen, _reward(config, task))


def _chosen_starts(config: RunConfig) -> tuple[str, str]:
    """The level of the starts that training chooses, and in words which they are."""
    section = getattr(config, config.run.algorithm)
    level, said = "A", ""
    if section.visited_state_resets:
        level = "B"
        share = 100 * section.visited_state_resets
        said += f", and first {share:.0f} %, in the end none at its own moments"
    if section.video_state_resets:
        level = "V"
        share = 100 * section.video_state_resets
        said += f", and first {share:.0f} %, in the end none at videos' frames"
    return level, said


def _reward(config: RunConfig, task: envs.TaskSpec) -> str:
    own = f"the task's own ({config.env.reward or task.rewards[0]})" if task.rewards else "its own"
    return {
        "learned": "learned from videos",
        "environmental": own,
        "stages": f"learned from videos, in its stages{_acting(config)}",
        "shaped": f"{own}, with one learned from videos as a potential",
    }.get(config.run.reward_form, config.run.reward)


def _acting(config: RunConfig) -> str:
    """Who acts in the stages, in words; "" if it is one network."""
    count = config.ppo.sub_policies if config.run.algorithm == "ppo" else 1
    return f", each with a sub-policy of its own ({count})" if count > 1 else ""


def of_all(configs: Iterable[RunConfig]) -> str:
    """The levels of several learners in one sentence, each with all that it says but the reward."""
    each = dict.fromkeys(given(config)._replace(reward="the row's") for config in configs)
    return f"Given at {'; or at '.join(map(str, each))}." if each else ""
