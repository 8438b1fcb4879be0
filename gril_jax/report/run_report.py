"""Makes a run's report: pictures, and one page that holds them and the policy's video.

Only the folder is read, and the demonstrations that its configuration names, if they are still
there. What is not there yet leaves a sentence in its place; what is damaged or lost is an error.
The same folder gives the same page, byte for byte, and no clock is on it.
"""

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.config.run_config import is_one_network
from gril_jax.config.task import NO_TASK
from gril_jax.demos.vision.video import read_fps
from gril_jax.errors import DemoError, RunError
from gril_jax.runs.json_lines import CLOCKS
from gril_jax.runs.reading import read_phases, require_single

from .curves import learning_curve, pretrain_curve, reward_profile
from .data import Inputs, films_of, read_inputs, read_outcome, read_versions
from .film_audit_page import figure_table
from .filmstrip import Film, contact_sheet
from .headline import audit_kept, audit_of, headline, verdict
from .html import Part, Section, Step, render, save
from .rates import Rate, rates
from .style import png

_TOP = 4  # numbers on the first screen
_NO_POLICY = Part("No policy has been trained in this run.")


def write_report(run_folder: str | os.PathLike, *, demos: Path | None = None) -> Path:
    """Draws everything about a run, finished or not, into its folder: PNGs and
    `report.html`, which needs no other file and whose path is returned. Its demonstration set is at
    `demos`, or where the run finds it. A folder of no run or of a
    table, or one that is damaged or cannot be written to, is a RunError."""
    folder = Path(run_folder)
    require_single(folder)
    try:
        run = read_inputs(folder, demos)
        films = films_of(run)
        tiles = headline(run.results)
        demonstrations = _demonstrations(run, films)
        loss, profile = _loss(run), _profile(run, films)
        if run.rows[run.config.run.algorithm]:
            film, beside = _rollout(run), [_learning_curve(run), profile]
            later = [Section("Training the reward", [loss])]
            later.append(Section("Demonstrations", [demonstrations]))
        else:
            film, beside = demonstrations, [loss, profile]
            later = [Section("The policy", [_NO_POLICY])]
        page = render(
            title=f"GRIL run {folder.resolve().name}",
            summary=_summary(run),
            verdict=verdict(run.results),
            tiles=tiles[:_TOP],
            film=film,
            beside=beside,
            sections=[*_audit(run), *later, Section("What next", steps=_next(run))],
            more=tiles[_TOP:],
            **_what_was_run(run),
        )
    except DemoError as error:
        raise RunError(str(error).removesuffix(".")) from error
    save(run.folder / "report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"


def _demonstrations(run: Inputs, films: Sequence[Film]) -> Part:
    """The contact sheet."""
    if run.demos is None:
        gone = "This run's folder holds no demonstrations, so none are shown."
        if run.config.demos.path:
            gone = (
                f"The demonstrations were in {run.config.demos.path}, where they are no more: if "
                "they lie elsewhere now, gril report RUN --demos FOLDER shows them."
            )
        return Part(gone)
    demos = run.demos
    return Part(
        f"{len(films)} of {len(demos)} demonstrations ({demos.source}), each from its first frame "
        "to its last. Every object should be in a box with its own number throughout; a thick box "
        "marks what has moved, which counts more in the reward.",
        save(run.folder / "demos.png", png(contact_sheet(films, demos.classes, demos.half_extent))),
        "Frames of demonstrations with boxes around their objects",
    )


def _loss(run: Inputs) -> Part:
    if not run.rows["pretrain"]:
        return Part("There are no metrics of encoder training.")
    loss = run.config.loss
    weights = {"reconstruction": loss.lambda_, "contrast": loss.perturbation_weight}
    return Part(
        "The encoder's loss and its parts, which add up to it. They should fall and level off.",
        save(run.folder / "pretrain.png", png(pretrain_curve(run.rows["pretrain"], weights))),
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
    dots = {
        0: " No stage was found in it.",
        1: " The numbered dot is where its one stage ends.",
    }.get(
        int(run.profiles.transitions[index, :length].sum()),
        " Numbered dots are where stages end, as the reward sees them.",
    )
    kept_aside = ", on which it was not trained" * (run.profiles.split[index] == "validation")
    frames = " A line ties each frame to its point." * (film is not None)
    return Part(
        f"The reward along {run.shown}{kept_aside}. It should climb while something is brought to "
        f"its place and stay flat while the empty hand travels.{frames}{dots}",
        save(run.folder / "reward_profile.png", png(figure)),
        "Learned reward against frames of one demonstration",
    )


def _learning_curve(run: Inputs) -> Part:
    random, rows = rates(run.results).get("success_random"), run.rows[run.config.run.algorithm]
    learned = run.config.run.reward_form in ("learned", "stages")
    offset = run.config.run.reward_offset if learned else 0.0
    figure = learning_curve(rows, random_success=random and random.share, offset=offset)
    return Part(
        "Line: training episodes from the task's own starts, with sampled actions."
        f"{_evaluations(rows)}{_of_random(random)} A reward that rises without success has missed "
        "what the task is about.",
        save(run.folder / "rl_curve.png", png(figure)),
        "Success rate and mean reward against environment steps",
    )


def _evaluations(rows: Sequence[Mapping[str, Any]]) -> str:
    """A sentence on what the evaluations of a learning curve count; empty without any."""
    examined = [row for row in rows if row.get("eval/success") is not None]
    if not examined:
        return ""
    drawn = examined[0].get("eval/episodes") or 0
    return f" Marks: evaluations in between, {drawn:.0f} fresh starts for either kind."


def _of_random(random: Rate | None) -> str:
    return "" if random is None else f" Dashes: a random policy, {random.counted}."


def _rollout(run: Inputs) -> Part:
    outcome, path = read_outcome(run.folder), run.folder / "rollout.mp4"
    if outcome is None or not path.exists():
        return Part("The trained policy was not recorded.")
    read_fps(path)  # or a DemoError: a browser would show a damaged video as nothing
    said = ", ".join(
        f"{kind} ({'succeeds' if success else 'fails'})"
        for kind, success in zip(("worst", "median", "best"), outcome.success, strict=True)
    )
    return Part(
        f"The trained policy in three of {outcome.episodes} evaluation episodes, by their return: "
        f"{said}.",
        path.read_bytes(),
        "The trained policy",
        "video/mp4",
    )


def _summary(run: Inputs) -> str:
    chosen = run.config
    learner = f", {chosen.run.algorithm.upper()}" * bool(run.rows[run.config.run.algorithm])
    of = f"Task {chosen.env.shown_name}" if chosen.env.name != NO_TASK else "Videos alone, no task"
    given = run.results.get("given")
    return (
        f"{of}, {chosen.run.reward_form} reward, {chosen.encoder.kind} encoder"
        f"{learner}, seed {chosen.run.seed}" + f". The learner is given {given}." * bool(given)
    )


def _audit(run: Inputs) -> list[Section]:
    """The figures of the reward's audit, that of `gril audit` if there is one; empty without."""
    found = audit_of(run.results)
    return [] if found is None else [Section("The audit of the reward", [figure_table(found)])]


def _next(run: Inputs) -> list[Step]:
    """Next steps with the run."""
    at = shlex.quote(str(run.folder))
    audited = (run.folder / "audit" / "report.html").is_file()
    looked = [Step("The audit of its reward, with maps of it", page="audit/report.html")]
    steps = looked if audited else []
    steps.append(Step("Search for states that the reward overestimates.", f"gril audit {at}"))
    steps.append(Step("Find the subtasks in the reward.", f"gril subtasks {at}"))
    if run.rows[run.config.run.algorithm]:
        steps.append(Step("Play the policy from other starts.", f"gril eval {at} --episodes 1000"))
        if is_one_network(run.config):
            export = f"gril export {at} --what policy --out policy.npz"
            steps.append(Step("Take the policy to a robot.", export))
    steps.append(
        Step("Take the reward to your own simulator.", f"gril export {at} --out reward.npz")
    )
    if run.config.env.name != NO_TASK:
        again = f"gril sweep {at}/config.yaml --seeds 5 --out NEW"
        steps.append(Step("See how much depends on the seed.", again))
    return steps


def _what_was_run(run: Inputs) -> dict[str, Any]:
    versions = read_versions(run.folder)
    known = ("command", "device", "python", "platform")
    results = {name: value for name, value in run.results.items() if name not in CLOCKS}
    if audit_of(results) is not None:
        results["audit"] = audit_kept(results["audit"])
    return {
        "facts": _in_text({name: versions[name] for name in known if name in versions}),
        "tables": {
            "All results": _in_text(results),
            "Package versions": _in_text(versions.get("packages", {})),
        },
        "listings": {"Configuration": read_phases(run.folder).config},
    }


def _in_text(rows: Mapping[str, Any]) -> dict[str, str]:
    return {str(name): str(value) for name, value in rows.items()}
