"""Doubts about stages: of the reward as a whole, and of each demonstration. No label is used."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# Share of held-out demonstrations that must show as many ends as are agreed on. With the reward of
# `match_regions`, which has the task's two stages, 15 of 16 do, and with that of
# `match_regions_fast`, which has a third, 11 of 16.
_AS_MANY = 0.8
_TIMES = 3.0  # the usual duration of a stage, by which one is far from the others'


class Stages(NamedTuple):
    """The stages that were found in B demonstrations."""

    reward: Float[np.ndarray, "B T"]  # smoothed
    ends: Int[np.ndarray, "B K"]  # agreed on, last frames
    found: Bool[np.ndarray, "B K"]  # whether the demonstration itself shows it
    alone: Int[np.ndarray, "B M"]  # ends that each shows by itself, filled up with -1
    level: Float[np.ndarray, "K"]  # mean reward at each
    prominence: float  # least height of a stage's rise
    fps: float


def doubt(alone: Int[np.ndarray, "B M"], held_out: Sequence[bool], agreed: int) -> str | None:
    """A sentence if held-out demonstrations disagree on the number of stages, else None.

    A reward that is fit for stages shows them in each single video, also in one that it was not
    trained on.

    Args:
      alone: ends that each demonstration shows by itself, frames, filled up with -1.
      held_out: which of them were kept aside; if none was, all count.
      agreed: number of ends on which all demonstrations together agree.
    """
    counts = (alone >= 0).sum(axis=1)
    counts = counts[np.array(held_out)] if any(held_out) else counts
    others = counts[counts != agreed]
    if np.mean(counts == agreed) >= _AS_MANY:
        return None
    least, most = others.min(), others.max()
    shown = f"{least}" if least == most else f"{least} to {most}"
    return (
        f"doubtful: only {len(counts) - len(others)} of {len(counts)} held-out demonstrations show "
        f"{agreed} end{'s' * (agreed != 1)} by themselves and the others {shown}, so this reward "
        "may not be fit for stages: learn it with perturbed frames "
        "(--pretrain.num-perturbations 4)"
    )


def of_demonstrations(made: Stages) -> list[list[str]]:
    """Reasons to doubt the stages of each demonstration; none if there is no doubt.

    - It shows no end of a stage by itself, so that the end was put where the others have it.
    - An end is far from the others': its reward differs from their mean by more than the
      prominence, or the stage takes 3 times as long as the median, or a third of it.
    - Two ends are equally likely: it shows another one, which is no stage's, at a reward that is
      as near to the stage's, or within half the prominence of it.
    """
    lasts = np.diff(made.ends, axis=1, prepend=0) / made.fps
    usual = np.median(lasts, axis=0)
    return [_of_one(made, i, lasts[i], usual) for i in range(len(made.ends))]


def _of_one(made: Stages, i: int, lasts, usual) -> list[str]:
    reward, ends = made.reward[i], made.ends[i]
    others = [e for e in made.alone[i].tolist() if e >= 0 and e not in ends[made.found[i]]]
    said = []
    for k, end in enumerate(ends.tolist()):
        stage, off = f"stage {k + 1}", abs(reward[end] - made.level[k])
        if not made.found[i, k]:
            said.append(f"shows no end of {stage} by itself")
        elif off > made.prominence:
            said.append(f"ends {stage} at a reward of {reward[end]:.2f}, not {made.level[k]:.2f}")
        if lasts[k] > _TIMES * usual[k] or lasts[k] * _TIMES < usual[k]:
            said.append(f"takes {lasts[k]:.1f} s for {stage}, not {usual[k]:.1f} s")
        near = max(off, made.prominence / 2)
        alike = [e for e in others if abs(reward[e] - made.level[k]) <= near]
        if made.found[i, k] and alike:
            said.append(f"may end {stage} at {alike[0] / made.fps:.1f} s as well")
    return said
