"""Trains in rounds: a reward learns from the videos, and from what policies before it exploited.

gril train CONFIG --rounds 3

A policy finds the states that its reward overestimates. The next round's reward learns from them as
hard negatives (`gril_jax.pretraining.hard_negatives`), and a new policy from that reward. No one
looks at it, and neither the task's reward nor its success is used. Later rounds are not always
better. So each policy is also judged by the videos: how many of its episodes end as they do.

Each round is a run of its own, in the folders `round-1`, `round-2` and so on. One that is cut off
goes on with `gril train --resume OUT/round-2`; the rounds after it are not made.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from gril_jax.config import RunConfig
from gril_jax.report import rates
from gril_jax.report.headline import audit_sentence
from gril_jax.runs import run_dir
from gril_jax.runs.reading import read_results
from gril_jax.safe_files import writing

from . import evaluate, train
from .pretrain import Echo

AT_MOST = 2  # earlier rounds that a reward learns from: the last ones


def main(config: RunConfig, *, rounds: int, echo: Echo = print) -> Path:
    """Makes so many rounds; returns the folder that has them."""
    out = Path(config.run.out) if config.run.out else run_dir.default_path(config.run.seed)
    with writing(out.parent):
        out.mkdir(parents=True)
    done: list[Path] = []
    for number in range(1, rounds + 1):
        echo(f"round {number} of {rounds}")
        run = dataclasses.replace(config.run, out=str(out / f"round-{number}"))
        own = dataclasses.replace(config, run=run)
        done.append(train.main(own, hard_negatives=done[-AT_MOST:], echo=echo))
    count = config.run.eval_episodes
    found = [evaluate.main(x, episodes=count, echo=_silent) for x in done]
    ends = [one.get("ends_as_videos") for one in found]
    echo("\n" + "\n".join(table(done, ends)))
    shares = [share for share in ends if share is not None]
    if shares:
        best = ends.index(max(shares))
        echo(f"most often like the videos ends the policy of round {best + 1}: {done[best]}")
    return out


def table(runs: Sequence[Path], ends: Sequence[float | None]) -> list[str]:
    """A line for each round: its success, its episodes that end as videos do (None: not known), its
    audit and its hard negatives."""
    lines = []
    for number, (folder, share) in enumerate(zip(runs, ends, strict=True), 1):
        results = read_results(folder)
        said = [rates.sentences(results)[0]]
        if share is not None:
            said.append(f"{share:.1%} of episodes end as the videos do")
        if "audit" in results:
            said.append(audit_sentence(results).partition(" (")[0])
        if taught := results.get("hard_negatives"):
            said.append(f"{taught} states of earlier policies as hard negatives")
        lines.append(f"round {number}: {'; '.join(said)}")
    return lines


def _silent(line: str) -> None:
    """Says nothing: a round has printed its success."""
