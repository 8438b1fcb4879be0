"""Configurations drawn at random: the defaults with some fields changed, each within its rule."""

import dataclasses
import types
import typing
from typing import Literal

from hypothesis import assume
from hypothesis import strategies as st

from gril_jax.config import RunConfig
from gril_jax.config.command_line import options
from gril_jax.config.task import BLOCK_COLOURS, BLOCK_SHAPES
from gril_jax.errors import ConfigError

FIELDS = {
    option.path: (name, option.kind) for name, option in options(RunConfig).items() if "." in name
}
_BLOCKS = st.sampled_from([f"{c} {s}" for c in BLOCK_COLOURS for s in BLOCK_SHAPES])
_WORDS = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1).filter(
    lambda word: word.strip() and word != "None"
)
_OF_TEXT = {
    "name": st.sampled_from(["match_regions", "shoes_in_box", "find_dupe"]),
    "reward": st.just("sparse"),
    "targets": st.lists(_BLOCKS, min_size=1, max_size=3, unique=True).map(tuple),
    "distractors": st.lists(_BLOCKS, max_size=3, unique=True).map(tuple),
    "options": st.lists(st.sampled_from(["a=1", "b=x y", "c=="]), unique=True).map(tuple),
    "sinks": st.sampled_from([(), ("wandb",), ("tensorboard", "wandb")]),
}  # fmt: skip


def values(path):
    """Values that a field may have."""
    section, name = path
    kind = FIELDS[path][1]
    field = next(f for f in dataclasses.fields(getattr(RunConfig(), section)) if f.name == name)
    drawn = (
        _OF_TEXT[name] if (name in _OF_TEXT and section != "run") or name == "sinks" else _of(kind)
    )
    if type(None) in typing.get_args(kind):
        drawn |= st.none()
    return drawn.filter(field.metadata["holds"]) if field.metadata else drawn


def _of(kind):
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        return st.one_of([_of(one) for one in typing.get_args(kind) if one is not type(None)])
    if typing.get_origin(kind) is Literal:
        return st.sampled_from(typing.get_args(kind))
    if typing.get_origin(kind) is tuple:
        return st.lists(st.integers(1, 10**6), max_size=4).map(tuple)
    small = st.integers(0, 40) | st.integers(0, 2**31 - 1)
    part = st.floats(0, 1) | st.floats(1e-300, 1e300) | st.floats(-10, 10)
    return {bool: st.booleans(), int: small, float: part, str: _WORDS}[kind]


@st.composite
def changes(draw):
    """Up to four fields with other values, by their paths."""
    paths = draw(st.lists(st.sampled_from([*FIELDS]), max_size=4, unique=True))
    return {path: draw(values(path)) for path in paths}


def changed(fields):
    """The defaults with these fields, if they do not contradict each other."""
    sections = dict(vars(RunConfig()))
    for (section, name), value in fields.items():
        sections[section] = dataclasses.replace(sections[section], **{name: value})
    try:
        return RunConfig(**sections)
    except ConfigError:
        assume(False)
