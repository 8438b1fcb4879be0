"""Makes a run's report: pictures, videos, and one page that holds them all.

Only the folder is read, and the demonstrations that its configuration names, if they are still
there. What is not there yet leaves a sentence in its place; what is damaged or lost is an error.
The same folder gives the same page, byte for byte, and no clock is on it.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gril_jax.config.files import to_yaml
from gril_jax.config.task import NO_TASK
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
from gril_jax.runs import times
from gril_jax.runs.phases import require_single

from . import happenings
from .data import read_rollouts, read_versions
from .headline import headline, verdict
from .html import Part, Section, Step, render
from .inputs import Inputs, films_of, read_inputs
from .rates import UNKNOWN, Rate, rates

# Results that older runs have among others; no clock is on the page.
_CLOCKS = (*times.CLOCKS, "compile_s", "checkpoint_stall_s")
_TOP = 4  # numbers on the first screen
_NO_POLICY = Part("No policy has been trained in this run.")


def write_report(run_folder: str | os.PathLike) -> Path:
    """Draws everything about a run, finished or not, into its folder: PNGs, videos, and
    `report.html`, which needs no other file and whose path is returned. A folder of no run or of a
    table, or one that is damaged or cannot be written to, is a RunError."""
    folder = Path(run_folder)
    require_single(folder)
    try:
        run = read_inputs(folder)
        films = films_of(run)
        tiles = headline(run.results)
        demonstrations, tracked = _demonstrations(run, films)
        loss, profile = _loss(run), _profile(run, films)
        if run.rows[run.config.run.algorithm]:
            film, beside = _rollout(run), [_learning_curve(run), profile]
            later = [Section("Training the reward", [_both_outcomes(run), loss])]
            demonstrations.append(tracked)
        else:
            film, beside = tracked, [loss, profile]
            later = [Section("The learned reward", [_both_outcomes(run), _NO_POLICY])]
        page = render(
            title=f"GRIL run {folder.resolve().name}",
            summary=_summary(run),
            verdict=verdict(run.results),
            tiles=tiles[:_TOP],
            film=film,
            beside=beside,
            sections=[
                *later,
                Section("Demonstrations", demonstrations),
                Section("What next", steps=_next(run)),
            ],
            more=tiles[_TOP:],
            **_what_was_run(run),
        )
    except DemoError as error:
        raise RunError(str(error).removesuffix(".")) from error
    run.save("report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"


def _demonstrations(run: Inputs, films: Sequence[Film]) -> tuple[list[Part], Part]:
    """The contact sheet, and the video of one with its boxes."""
    if run.demos is None:
        gone = "This run's folder holds no demonstrations, so none are shown."
        if run.config.demos.path:
            gone = f"The demonstrations were in {run.config.demos.path}, where they are no more."
        return [], Part(gone)
    demos = run.demos
    sheet = run.save("demos.png", png(contact_sheet(films, demos.classes, demos.half_extent)))
    boxes = with_boxes(films[0], demos.classes, demos.half_extent)
    video = Part(
        f"{films[0].name} as the encoder gets it: boxes, classes, and what has moved (thick, and "
        "bold in the list). No box should jump or change its number.",
        run.save_video("demo.mp4", boxes, demos.fps),
        "A demonstration with boxes around its objects",
        "video/mp4",
    )
    return [
        Part(
            f"{len(films)} of {len(demos.entries)} demonstrations ({demos.source}), each from "
            "its first frame to its last. Every object should be in a box with its own number "
            "throughout; a thick box marks what has moved, which counts more in the reward.",
            sheet,
            "Frames of demonstrations with boxes around their objects",
        )
    ], video


def _loss(run: Inputs) -> Part:
    if not run.rows["pretrain"]:
        return Part("There are no metrics of encoder training.")
    return Part(
        "The encoder's loss and its parts. They should fall and level off.",
        run.save("pretrain.png", png(pretrain_curve(run.rows["pretrain"]))),
        "Encoder loss against gradient steps",
    )


def _profile(run: Inputs, films: Sequence[Film]) -> Part:
    if run.profiles is None:
        return Part("The reward has not been learned yet, so it has no profile.")
    index = run.profiles.names.index(run.shown)
    length = int(run.profiles.length[index])
    film = next((film for film in films if film.name == run.shown), None)
    if film and length > len(film.frames):
        raise RunError(
            f"{run.folder / 'profiles.npz'}: the profile of {run.shown!r} has {length} frames, "
            f"but its video has {len(film.frames)}"
        )
    figure = reward_profile(
        run.profiles.reward[index, :length],
        run.profiles.transitions[index, :length],
        frames=film and film.frames[:length],
        name=run.shown,
        fps=film and run.demos.fps,
    )
    ends = np.flatnonzero(run.profiles.transitions[index, :length]).tolist()
    kept_aside = ", on which it was not trained" * (run.profiles.split[index] == "validation")
    frames = " A line ties each frame to its point." * (film is not None)
    return Part(
        f"The reward along {run.shown}{kept_aside}. It should climb while something is brought to "
        f"its place and stay flat while the empty hand travels.{frames}{_dots(run, film, ends)}",
        run.save("reward_profile.png", png(figure)),
        "Learned reward against frames of one demonstration",
    )


def _dots(run: Inputs, film: Film | None, ends: Sequence[int]) -> str:
    """Sentences on the numbered dots of a profile; where the film is known, on each dot."""
    if not len(ends):
        return " No stage was found in it."
    words = " Numbered dots are where the reward has taken a step: ends of stages, as it sees them"
    if film is None:
        return f"{words}."
    seen = happenings.at_frames(film.tracks, ends, run.demos.classes, run.demos.robots)
    at = [f"{k + 1} (frame {end}): {seen[k]}" for k, end in enumerate(ends)]
    return f"{words}. {'; '.join(at)}."


def _both_outcomes(run: Inputs) -> Part:
    if run.profiles is None:
        return Part("Without a profile, successes and failures cannot be compared.")
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


def _learning_curve(run: Inputs) -> Part:
    random, rows = rates(run.results).get("success_random"), run.rows[run.config.run.algorithm]
    figure = learning_curve(rows, random_success=random and random.share)
    return Part(
        "Line: training episodes from the task's own starts, with sampled actions."
        f"{_evaluations(rows)}{_of_random(random)} A reward that rises without success has missed "
        "what the task is about.",
        run.save("rl_curve.png", png(figure)),
        "Success rate and mean reward against environment steps",
    )


def _evaluations(rows: Sequence[Mapping[str, Any]]) -> str:
    """A sentence on what the evaluations of a learning curve count; empty without any."""
    examined = [row for row in rows if row.get("eval/success") is not None]
    if not examined:
        return ""
    counts = [row.get("eval/episodes") for row in examined]
    drawn = UNKNOWN if None in counts else f"{counts[0]:.0f} fresh starts for either kind"
    return f" Marks: evaluations in between, {drawn}."


def _of_random(random: Rate | None) -> str:
    return "" if random is None else f" Dashes: a random policy, {random.counted}."


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
    outcome = "succeeds" if rollouts.success[rollouts.shown] else "fails"
    return Part(
        f"The trained policy in an evaluation episode that {outcome}, beside its reward.",
        run.save_video("policy.mp4", video, read_fps(path)),
        "The trained policy beside the curve of its reward",
        "video/mp4",
    )


def _summary(run: Inputs) -> str:
    chosen = run.config
    learner = f", {chosen.run.algorithm.upper()}" * bool(run.rows[run.config.run.algorithm])
    of = f"Task {chosen.env.shown_name}" if chosen.env.name != NO_TASK else "Films alone, no task"
    given = run.results.get("given")  # not in runs of older versions
    return (
        f"{of}, {chosen.run.reward} reward, {chosen.encoder.kind} encoder"
        f"{learner}, seed {chosen.run.seed}" + f". The learner is given {given}." * bool(given)
    )


def _next(run: Inputs) -> list[Step]:
    """Next steps with the run."""
    audited = (run.folder / "audit" / "report.html").is_file()
    looked = [Step("The audit of its reward, with maps of it", page="audit/report.html")]
    steps = looked if audited else []
    steps.append(Step("Search for states that the reward overestimates.", "gril audit RUN"))
    steps.append(Step("Find the subtasks in the reward.", "gril subtasks RUN"))
    if run.rows[run.config.run.algorithm]:
        steps += [
            Step("Play the policy from other starts.", "gril eval RUN --episodes 1000"),
            Step("Take the policy to a robot.", "gril export RUN --what policy --out policy.npz"),
        ]
    steps.append(Step("Take the reward to your own simulator.", "gril export RUN --out reward.npz"))
    if run.config.env.name != NO_TASK:
        again = "gril sweep RUN/config.yaml --seeds 5 --out NEW"
        steps.append(Step("See how much depends on the seed.", again))
    return steps


def _what_was_run(run: Inputs) -> dict[str, Any]:
    versions = read_versions(run.folder)
    known = ("command", "device", "python", "platform")
    results = {name: value for name, value in run.results.items() if name not in _CLOCKS}
    return {
        "facts": _in_text({name: versions[name] for name in known if name in versions}),
        "tables": {
            "All results": _in_text(results),
            "Package versions": _in_text(versions.get("packages", {})),
        },
        "listings": {"Configuration": to_yaml(run.config)},
    }


def _in_text(rows: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in rows.items()}
