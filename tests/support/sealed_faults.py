"""Faults of files that a stranger has sealed again: changed contents with a digest that fits.

Each draws one fault that no honest writer makes, and writes the file; whoever reads it must refuse
it. `FILES` has for each kind of file how it is written whole, broken, and read.
"""

import hashlib
import io
import json
import zipfile
from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st

from gril_jax.config import RunConfig
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.formats import boxes_of
from gril_jax.demos.formats.record import Film
from gril_jax.export import policy_file
from gril_jax.export.reward_file import load_reward, save_reward
from gril_jax.export.reward_format import sealed
from support import hostile
from support.run_folders import save_demos
from support.saved_rewards import CLASSES, CONFIGS, OBJECTS, made

_ODD = ("\0", "a\x1b[31mb", "\x1b]0;owned\x07", "a\rb", "\ud800", "a\x9b2J", "\u202eabc")
_WRONG = {  # of a value's type: what a reader must not take for it
    str: (7, 1.5, ["a"], {"a": 1}, True, *_ODD),
    int: ("7", 1.5, -(10**30), [7], True, float("nan"), {}),
    float: ("7", float("nan"), float("inf"), -1.0, [1.0], 10**400, {}),
    list: ("a", 7, {}, [[1]], [None], ["\x1b[31m"]),
    dict: ("a", 7, [], "\x1b[31m"),
    bool: ("true", 1, None, []),
}
_MAY_LACK = ("pair_statistics",)  # files from before an option came
_POLICY_MAY_LACK = ("smoothing", "noise")  # beside the objects of its activity
_FREE = ("provenance", "reader", "gril_jax", "activity.tau", "own_options")  # any value is one


# --- descriptions


def _places(tree, path=()):
    """The paths of all fields of a description, but for those of which any value is one."""
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        if key in _FREE:
            continue
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*path, key))


def _changed(draw, tree):
    """A copy with one field of another type, out of every range, or not there."""
    tree = json.loads(json.dumps(tree))
    *path, last = draw(st.sampled_from([*_places(tree)]))
    holder = tree
    for key in path:
        holder = holder[key]
    value = holder[last]
    needed = isinstance(holder, dict) and last not in _MAY_LACK
    needed = needed and not (last in _POLICY_MAY_LACK and "objects" in holder)
    if needed and draw(st.integers(0, 4)) == 0:
        del holder[last]
    elif value is None:
        holder[last] = draw(st.sampled_from([[1], {"a": 1}, "\x1b[31m", float("nan")]))
    else:
        others = [one for one in _WRONG[type(value)] if repr(one) != repr(value)]
        holder[last] = draw(st.sampled_from(others))
    return tree


# --- arrays


def _member(array, shape=None, dtype=None):
    """The bytes of an .npy file, whose header may lie."""
    shape = array.shape if shape is None else shape
    header = {"descr": dtype or array.dtype.str, "fortran_order": False, "shape": shape}
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + array.tobytes()


def _members(path):
    with np.load(path) as file:
        return {name: _member(file[name]) for name in file.files}, dict(np.load(path))


def _broken_array(draw, members, arrays, positive):
    """One array of another shape, type or range, or not there."""
    name = draw(st.sampled_from(sorted(set(arrays) - {"description"})))
    array = arrays[name]
    kind = draw(st.sampled_from(["nan", "inf", "huge", "type", "more", "axis", "-1", "lie", "gone",
                                 "new", "below"]))  # fmt: skip
    flat, at = array.copy().reshape(-1), draw(st.integers(0, max(array.size - 1, 0)))
    if kind in ("nan", "inf") and array.dtype.kind == "f":
        flat[at] = np.nan if kind == "nan" else draw(st.sampled_from([np.inf, -np.inf]))
        members[name] = _member(flat.reshape(array.shape))
    elif kind == "huge" and array.dtype.kind == "f" and array.ndim == 2:
        members[name] = _member(np.full_like(array, 3e38))
    elif kind == "type":
        members[name] = _member(array.astype(draw(st.sampled_from([np.int8, np.float16]))))
    elif kind == "axis":
        members[name] = _member(array[..., None, None])
    elif kind == "-1":
        members[name] = _member(array, (*array.shape[:-1], -1))
    elif kind == "lie":
        members[name] = _member(array, (*array.shape, draw(st.integers(2, 10**12))))
    elif kind == "gone":
        del members[name]
    elif kind == "below" and positive:
        name = draw(st.sampled_from(positive))
        low = draw(st.sampled_from([0.0, -0.0, -1.0, -1e-30]))
        members[name] = _member(np.full_like(arrays[name], low))
    else:
        members[name] = _member(np.concatenate([flat, flat]))
    return members


def _archive(members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, contents in members.items():
            file.writestr(f"{name}.npy", contents)
    return stream.getvalue()


def _sealed_file(draw, whole, path, positive):
    """A reward's or policy's file with one fault, and a digest that fits."""
    members, arrays = _members(whole)
    if draw(st.booleans()):
        about = _changed(draw, json.loads(str(arrays["description"])))
        text = json.dumps(about)
        members["description"] = _member(np.array(text.encode("utf-8", "replace").decode()))
    else:
        members = _broken_array(draw, members, arrays, positive)
    path.write_bytes(sealed(_archive(members)))


# --- the kinds of files


def _whole_reward(folder, kind="paper"):
    save_reward(
        folder / "r.npz", made(CONFIGS[kind]), CONFIGS[kind], classes=CLASSES, robots=("robot",),
        objects=OBJECTS, half_extent=1.0, unit="m",
    )  # fmt: skip
    return folder / "r.npz"


def _whole_ensemble(folder):
    return _whole_reward(folder, "ensemble")


def _broken_reward(draw, whole, folder):
    _sealed_file(draw, whole, folder / "r.npz", ["scale", "alpha"])
    return folder / "r.npz"


class _Task(NamedTuple):
    observation_size: int = 3
    action_size: int = 2
    control_hz: float = 8.0


def _whole_policy(folder):
    rng, arrays = np.random.default_rng(0), {"observation_mean": np.zeros(4)}
    arrays["observation_limit"] = np.full(4, 5.0)
    for i, (of, to) in enumerate([(4, 6), (6, 4)]):
        arrays[f"kernel_{i}"], arrays[f"bias_{i}"] = rng.normal(size=(of, to)), rng.normal(size=to)
    arrays = {name: array.astype(np.float32) for name, array in arrays.items()}
    policy_file.write(
        folder / "p.npz", arrays, policy_file.describe(RunConfig(), _Task(), arrays, ["block"])
    )
    return folder / "p.npz"


def _broken_policy(draw, whole, folder):
    _sealed_file(draw, whole, folder / "p.npz", ["observation_limit"])
    return folder / "p.npz"


def _read_policy(path):
    about, _ = policy_file.load(path)
    policy_file.env_of(about, path)


def _whole_set(folder):
    save_demos(folder / "set", names=("one", "two"))
    return folder / "set"


def _broken_set(draw, whole, folder):
    made_ = folder / "set"
    made_.mkdir(exist_ok=True)
    for file in whole.iterdir():
        (made_ / file.name).write_bytes(file.read_bytes())
    header = json.loads((whole / "demos.json").read_text())
    if draw(st.booleans()):
        header = _changed(draw, header)
    else:
        file = made_ / "000.npz"
        members, arrays = _members(file)
        file.write_bytes(_archive(_broken_array(draw, members, arrays, ["size"])))
        header["demos"][0]["tracks_sha256"] = hashlib.sha256(file.read_bytes()).hexdigest()
    (made_ / "demos.json").write_text(json.dumps(header))
    return made_


_FRAMES = 8


def _whole_boxes(folder):
    (folder / "a.csv").write_text(hostile.BOXES + "7,goal,0,0,8,8\n7,green star,4,4,12,12\n")
    return folder / "a.csv"


def _broken_boxes(draw, whole, folder):
    rows = [line.split(",") for line in whole.read_text().splitlines()]
    row, at = draw(st.integers(1, len(rows) - 1)), draw(st.integers(0, 5))
    odd = [*_ODD[:4], "x" * 200] if at == 1 else ["nan", "inf", "-1e31", "a", "1e400", "--1"]
    rows[row][at] = draw(st.sampled_from(odd))
    text = "\n".join(map(",".join, rows))
    (folder / "a.csv").write_text(text, encoding="utf-8", errors="replace")
    return folder / "a.csv"


def _read_boxes(path):
    boxes_of(Film(path.with_suffix(".mp4"), [i / 8 for i in range(_FRAMES)], 16, 16))


FILES = {
    "reward": (_whole_reward, _broken_reward, load_reward),
    "ensemble": (_whole_ensemble, _broken_reward, load_reward),
    "policy": (_whole_policy, _broken_policy, _read_policy),
    "set": (_whole_set, _broken_set, load_demo_set),
    "boxes": (_whole_boxes, _broken_boxes, _read_boxes),
}
