"""A run's folder -> its pictures, its videos, and one page that holds them all.

Only the folder is read, and the demonstrations that its configuration names, if they are still
there. What is missing leaves a sentence in its place; what is damaged is an error. The same
folder gives the same page.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.config.files import to_yaml
from gril_jax.demos.vision.video import read_fps, read_video
from gril_jax.errors import DemoError, RunError
from gril_jax.report.figures.curves import (
    learning_curve,
    pretrain_curve,
    reward_profile,
    success_failure,
)
from gril_jax.report.figures.filmstrip import Film, beside_reward, contact_sheet, with_boxes
from gril_jax.report.figures.style import png

from .data import number, read_rollouts, read_versions
from .headline import headline, in_words, stage_times
from .html import Part, Section, render
from .inputs import Inputs, films_of, read_inputs
from .kinds import require_single

__all__ = ["write_report"]


def write_report(run_folder: str | os.PathLike) -> Path:
    """Draws everything about a run into its folder: PNGs, videos, and `report.html`.

    Args:
      run_folder: see `gril_jax.runs.run_dir`; finished or not.

    Returns:
      The page, which needs no other file.

    Raises:
      RunError: it is no run's folder, or that of a table; a file in it is damaged, or it cannot
        be written to.
    """
    folder = Path(run_folder)
    require_single(folder)
    try:
        run = read_inputs(folder)
        films = films_of(run)
        page = render(
            title=f"GRIL run {folder.resolve().name}",
            summary=_summary(run),
            tiles=headline(run.results),
            sections=[
                Section("Demonstrations", _demonstrations(run, films)),
                Section("The learned reward", _learned_reward(run, films)),
                Section("The policy", _policy(run)),
            ],
            **_what_was_run(run),
        )
    except DemoError as error:
        raise RunError(str(error).removesuffix(".")) from error
    run.save("report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"


def _demonstrations(run: Inputs, films: Sequence[Film]) -> list[Part]:
    if run.demos is None:
        gone = "This run's folder holds no demonstrations, so none are shown."
        if run.config.demos.path:
            gone = f"The demonstrations were in {run.config.demos.path}, where they are no more."
        return [Part(gone)]
    demos = run.demos
    sheet = run.save("demos.png", png(contact_sheet(films, demos.classes, demos.half_extent)))
    video = with_boxes(films[0], demos.classes, demos.half_extent)
    return [
        Part(
            f"{len(films)} of {len(demos.entries)} demonstrations ({demos.source}), each from "
            "its first frame to its last. Every object should be in a box with its own number "
            "throughout; a thick box marks what has moved, which counts more in the reward.",
            sheet,
            "Frames of demonstrations with boxes around their objects",
        ),
        Part(
            f"{films[0].name} as the encoder gets it: boxes, classes, and what has moved "
            "(thick, and bold in the list). No box should jump or change its number.",
            run.save_video("demo.mp4", video, demos.fps),
            "A demonstration with boxes around its objects",
            "video/mp4",
            small=True,
        ),
    ]


def _learned_reward(run: Inputs, films: Sequence[Film]) -> list[Part]:
    parts = []
    if run.profiles is None:
        parts.append(Part("The reward has not been learned yet, so it has no profile."))
    else:
        parts += [_profile(run, films), _both_outcomes(run)]
    if run.rows["pretrain"]:
        parts.append(
            Part(
                "The encoder's loss and its parts. They should fall and level off.",
                run.save("pretrain.png", png(pretrain_curve(run.rows["pretrain"]))),
                "Encoder loss against gradient steps",
                small=True,
            )
        )
    else:
        parts.append(Part("There are no metrics of encoder training."))
    return parts


def _profile(run: Inputs, films: Sequence[Film]) -> Part:
    index = run.profiles.names.index(run.shown)
    length = int(run.profiles.length[index])
    film = next((film for film in films if film.name == run.shown), None)
    if film is not None and length > len(film.frames):
        raise RunError(
            f"{run.folder / 'profiles.npz'}: the profile of {run.shown!r} has {length} frames, "
            f"but its video has {len(film.frames)}"
        )
    figure = reward_profile(
        run.profiles.reward[index, :length],
        run.profiles.transitions[index, :length],
        frames=None if film is None else film.frames[:length],
        name=run.shown,
        fps=None if film is None else run.demos.fps,
    )
    kept_aside = ", on which it was not trained" * (run.profiles.split[index] == "validation")
    frames = " The frames above belong to the points that they are tied to." * (film is not None)
    return Part(
        f"The reward along {run.shown}{kept_aside}: a staircase that climbs while a block is "
        "brought to its place and is flat while the empty hand travels. Numbered dots are ends "
        "of stages found in such curves alone; they should fall where a block has arrived."
        f"{frames}",
        run.save("reward_profile.png", png(figure)),
        "Learned reward against frames of one demonstration",
    )


def _both_outcomes(run: Inputs) -> Part:
    aside = run.profiles.traces("validation")
    success, failure = aside or run.profiles.traces("train"), run.profiles.traces("failure")
    if not success or not failure:
        kind = "failed" if success else "successful"
        return Part(f"The run has no {kind} demonstrations, so the two cannot be compared.")
    origin = "that were kept aside from training" if aside else "that it was trained on"
    return Part(
        f"The reward along successful demonstrations {origin} (left) and along failed ones "
        "(right), which never train it. Successes should end near the top, failures below "
        "them; the mean keeps the last value of those that have ended.",
        run.save("success_failure.png", png(success_failure(success, failure))),
        "Learned rewards of successful and of failed demonstrations",
    )


def _policy(run: Inputs) -> list[Part]:
    rows = run.rows["ppo"] or run.rows["sac"]
    if not rows:
        return [Part("No policy has been trained in this run.")]
    random = number(run.results, "success_random", "results.json")
    figure = learning_curve(rows, random_success=random)
    dashed = " well above the dashed line of a random policy" * (random is not None)
    curve = Part(
        f"Training episodes, in which actions are sampled. Success should rise{dashed}, and "
        "the reward with it; a reward that rises alone has missed what the task is about.",
        run.save("rl_curve.png", png(figure)),
        "Success rate and mean reward against environment steps",
    )
    return [curve, _rollout(run)]


def _rollout(run: Inputs) -> Part:
    rollouts, path = read_rollouts(run.folder), run.folder / "rollout.mp4"
    if rollouts is None or not path.exists():
        return Part("The trained policy was not filmed.")
    frames, reward = read_video(path), rollouts.reward[rollouts.shown]
    if len(frames) != len(reward) + 1:
        raise RunError(
            f"{path} has {len(frames)} frames, but rollouts.npz has {len(reward)} rewards, "
            f"which need {len(reward) + 1} frames"
        )
    learned = run.config.run.reward == "learned"
    video = beside_reward(frames, reward, title="Learned reward" if learned else "Task's reward")
    outcome = "succeeded" if rollouts.success[rollouts.shown] else "failed"
    return Part(
        f"An evaluation episode of the trained policy, which {outcome}, beside its reward. "
        "Each block that is brought to its place should lift the curve by a step.",
        run.save_video("policy.mp4", video, read_fps(path)),
        "The trained policy beside the curve of its reward",
        "video/mp4",
    )


def _summary(run: Inputs) -> str:
    chosen = run.config
    text = (
        f"Task {chosen.env.name} with {len(chosen.env.targets)} blocks to bring in and "
        f"{len(chosen.env.distractors)} to keep out, {chosen.run.reward} reward, "
        f"seed {chosen.run.seed}."
    )
    return text if run.results else f"{text} The run has not finished, so it has no results yet."


def _what_was_run(run: Inputs) -> dict[str, Any]:
    versions = read_versions(run.folder)
    known = ("command", "device", "started", "python", "platform")
    facts = {name: versions[name] for name in known if name in versions}
    times = {name: in_words(seconds) for name, seconds in stage_times(run.results)}
    return {
        "facts": _in_text(facts) | {f"time for {name}": text for name, text in times.items()},
        "tables": {
            "All results": _in_text(run.results),
            "Package versions": _in_text(versions.get("packages", {})),
        },
        "listings": {"Configuration": to_yaml(run.config)},
    }


def _in_text(rows: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in rows.items()}
