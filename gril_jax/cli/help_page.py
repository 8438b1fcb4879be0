"""The short help of verbs that take a whole configuration; `--help-all` lists every option."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gril_jax.config import RewardSections, RunConfig
from gril_jax.config.command_line import options

_INDENT, _WIDTH = 30, 100
_FORMS = {"Literal": "NAME", "tuple": "A B ...", "float": "NUMBER", "int": "N", "bool": "BOOL"}

Sections = Mapping[str, Mapping[str, str]]  # by titles: options, some with a value, and their texts

_TASK = {
    "--task": "One of gril's own, FILE.py:FUNCTION of yours, or an installed entry point.",
    "--env.options": "Further options of the task, each NAME=VALUE.",
}
_DEMOS = {
    "--demos": "Folder of a demonstration set; without it the task's expert makes one.",
    "--demos.num": "Scripted demonstrations to learn from.",
}
_RUN = {
    "--out": "Folder to create for the results; None names one after the time, under runs/.",
    "--seed": "Seed of everything but the scripted demonstrations.",
    "--resume RUN": "Go on with a run that was cut off, bit for bit.",
}
_NEW = {
    "--hard-negatives RUN[,RUN]": "Learn from states that one or two runs' rewards overestimated.",
    "--dry-run": "Say what would run, how long and in how much memory; write nothing.",
}
_REWARD = {
    "--pretrain.steps": "Gradient steps of the encoder.",
    "--encoder.kind": "Network from boxes, or from pictures, to a latent.",
    "--loss.perturbation-weight": "Weight of perturbed frames: copies with displaced objects.",
    "--lambda": "Weight of reconstruction relative to temporal cycle-consistency.",
    "--pool.alpha": "Weight of an object that has moved; one that has not weighs 1.",
}
_POLICY = {
    "--algorithm": "Algorithm that trains the policy.",
    "--reward": "learned, environmental, stages or shaped; or the file or run of a reward.",
    "--ppo.num-timesteps": "Control steps in all, over all environments.",
    "--ppo.num-envs": "Environments that are stepped together.",
    "--ppo.learning-rate": "Learning rate of Adam.",
    "--ppo.discounting": "Discount of a control step.",
}
_ASKED = {
    "--run.audit": "Gradient ascents of the audit that follows training, 0 for none.",
    "--run.evaluations": "Evaluations during policy training.",
}
PRETRAIN: Sections = {
    "The task and its demonstrations": _TASK | _DEMOS,
    "The run": _RUN | _NEW | {"--run.sinks": "tensorboard, wandb: metrics go there, too."},
    "The reward": _REWARD,
}
TRAIN: Sections = PRETRAIN | {
    "The task and its demonstrations": _TASK
    | {"--env.variant": "Quantities randomised at the start."}
    | _DEMOS,
    "The run": _RUN | _NEW | _ASKED,
    "The policy": _POLICY,
}
SWEEP: Sections = TRAIN | {"The run": _RUN | {"--run.audit": _ASKED["--run.audit"]}}


@dataclass(frozen=True)
class Page:
    """The short help of a verb."""

    prog: str
    about: str
    sections: Sections
    own: Mapping[str, str] = field(default_factory=dict)
    """The verb's own options with their texts, which come first."""

    @property
    def schema(self) -> type[Any]:
        """What `--help-all` lists: of a verb without a policy no options of one."""
        return RewardSections if self.sections is PRETRAIN else RunConfig

    def text(self, given: Any) -> str:
        """The page, with the values that the options have in a configuration."""
        every = {name for texts in self.sections.values() for name in texts}
        usage = "" if self.prog == "gril quickstart" else " [CONFIG]"
        usage += "".join(f" [{option}]" for option in [*self.own][:2]) or " [--task FILE:make]"
        usage += " [--demos SET]" if "--demos" in every else ""
        lines = [f"usage: {self.prog}{usage} [--resume RUN] [options]", ""]
        lines += [textwrap.fill(self.about, _WIDTH, break_on_hyphens=False)]
        if self.own:
            lines += ["", "This command's own:", *(told(*one) for one in self.own.items())]
        for title, texts in self.sections.items():
            lines += ["", f"{title}:", *(_line(name, text, given) for name, text in texts.items())]
        last = told("--help-all", "Every option, with its section's name before it.")
        return "\n".join([*lines, "", "Everything else:", last]) + "\n"


def _line(name: str, text: str, given: Any) -> str:
    option = options(RunConfig).get(name)
    if option is None:
        return told(name, text)
    value = getattr(getattr(given, option.path[0]), option.path[1])
    shown = " ".join(map(str, value)) or "none" if isinstance(value, tuple) else value
    form = next((form for known, form in _FORMS.items() if known in str(option.kind)), "TEXT")
    return told(f"{name} {form}", f"{text} (default: {shown})")


def told(usage: str, text: str) -> str:
    """A line of a help page, wrapped beside its first column."""
    left, right = f"  {usage}  ".ljust(_INDENT), " " * _INDENT
    return textwrap.fill(
        text, _WIDTH, initial_indent=left, subsequent_indent=right, break_on_hyphens=False
    )
