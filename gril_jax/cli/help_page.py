"""The short help of verbs that take a whole configuration; `--help-all` lists every option."""

import ast
import dataclasses
import functools
import inspect
import re
import textwrap
from collections.abc import Mapping
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.command_line import options

_INDENT, _WIDTH = 30, 100

# What is said where the options' own texts are too long, or where they are no fields.
_TEXTS = {
    "--task": "Task: one of gril's own, FILE.py:FUNCTION of yours, or an installed entry point.",
    "--demos": "Folder of a demonstration set; without it the task's expert makes one.",
    "--resume": "Go on with a run that was cut off, bit for bit.",
    "--hard-negatives": "Learn from states that the rewards of one or two runs overestimated.",
    "--dry-run": "Say what would run, how long and in how much memory; write nothing.",
    "--help-all": "Every option, with its section's name before it.",
    "--lambda": "Weight of reconstruction relative to temporal cycle-consistency.",
}
_VALUES = {
    "--resume": "RUN", "--hard-negatives": "RUN[,RUN]", "--dry-run": "",
    "--help-all": "",
}  # fmt: skip

PRETRAIN: Mapping[str, tuple[str, ...]] = {
    "The task and its demonstrations": ("--task", "--env.options", "--demos", "--demos.num"),
    "The run": (
        "--out", "--seed", "--resume", "--hard-negatives", "--dry-run", "--run.sinks",
        "--run.checkpoint-every",
    ),
    "The reward": (
        "--pretrain.steps", "--encoder.kind", "--encoder.width",
        "--encoder.ensemble-size", "--loss.perturbation-weight", "--lambda", "--pool.alpha",
    ),
}  # fmt: skip
TRAIN = PRETRAIN | {
    "The task and its demonstrations": (
        "--task", "--env.options", "--env.variant", "--demos", "--demos.num",
    ),
    "The run": (
        "--out", "--seed", "--resume", "--dry-run", "--run.audit", "--run.eval-episodes",
    ),
    "The reward": (
        "--pretrain.steps", "--encoder.kind", "--loss.perturbation-weight", "--pool.alpha",
    ),
    "The policy": (
        "--algorithm", "--reward", "--ppo.num-timesteps", "--ppo.num-envs", "--ppo.learning-rate",
        "--ppo.discounting",
    ),
}  # fmt: skip
SWEEP = TRAIN | {"The run": ("--out", "--seed", "--resume", "--run.audit", "--run.evaluations")}


def page(
    usage: str,
    about: str,
    sections: Mapping[str, tuple[str, ...]],
    config: Any,
    shortcuts: Mapping[str, str],
    own: Mapping[str, str],
) -> str:
    """The page, with the values that the options have in a configuration; first come the verb's
    `own` options with their texts."""
    lines = [f"usage: {usage}", "", textwrap.fill(about, _WIDTH, break_on_hyphens=False)]
    if own:
        lines += ["", "This command's own:", *(_told(option, text) for option, text in own.items())]
    for title, names in sections.items():
        lines += ["", f"{title}:"]
        lines += [_line(name, shortcuts.get(name, name), config) for name in names]
    lines += ["", "Everything else:", _line("--help-all", "--help-all", config)]
    return "\n".join(lines) + "\n"


def _line(name: str, full: str, config: Any) -> str:
    section, _, field = full[2:].replace("-", "_").partition(".")
    text, value = _TEXTS.get(name), _VALUES.get(name)
    if value is None:
        holder = getattr(config, section)
        field = next(f for f in (field, f"{field}_") if hasattr(holder, f))
        text = text or _first_sentence(texts(type(holder))[field])
        text += f" (default: {_shown(getattr(holder, field))})"
        value = _kind(options(RunConfig)[full])
    return _told(f"{name} {value}".strip(), text)


def _told(option: str, text: str) -> str:
    left = f"  {option}  ".ljust(_INDENT)
    return textwrap.fill(
        text, _WIDTH, initial_indent=left, subsequent_indent=" " * _INDENT, break_on_hyphens=False
    )


def _first_sentence(text: str) -> str:
    whole = " ".join(text.split())
    return re.split(r"(?<=[.:;])\s", whole)[0].rstrip(".:;") + "."


def _shown(value: Any) -> str:
    return " ".join(map(str, value)) or "none" if isinstance(value, tuple) else str(value)


def _kind(kind: Any) -> str:
    """The form of a value in a word."""
    text = str(kind)
    forms = {"Literal": "NAME", "tuple": "A B ...", "float": "NUMBER", "int": "N", "bool": "BOOL"}
    return next((form for known, form in forms.items() if known in text), "TEXT")


@functools.cache
def texts(schema: type[Any]) -> dict[str, str]:
    """The text under each field of a dataclass, or under the one of its base that it replaces."""
    found: dict[str, str] = {}
    for kind in filter(dataclasses.is_dataclass, reversed(schema.mro())):
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
        found |= {
            field.target.id: text.value.value
            for field, text in zip(body.body, body.body[1:], strict=False)
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
        }
    return found
