"""A small audit made by hand: one start, two objects, five states, a grid of 2 x 2."""

import types

import numpy as np

from gril_jax.audit.ascent import Found
from gril_jax.audit.made import Judged, Rewards, States
from gril_jax.audit.measures import Audit, Measures
from gril_jax.audit.scene_reward import Scene
from gril_jax.audit.shortfalls import KINDS
from gril_jax.audit.states import FACTORS, Battery
from gril_jax.report.audit_page import Findings

FACTOR = ("start", "success", "touched", "wrong place", "random")
SCORE = (0.0, 1.0, 0.0, 0.0, 0.5)
PAID = (-1.0, -0.1, -0.9, -0.4, -0.95)
NUMBERS = {
    "order_accuracy": 0.98, "worst_violation": 0.55, "hack_gap": -0.05, "misranked_share": 0.5,
    "success_kept": 0.99,
    "hack_share": 1.05, "range": 0.9, "start_reward": -1.0, "worst_success": -0.1,
    "best_unearned": -0.05, "touch_share": np.nan, "push_share": 0.7,
}  # fmt: skip


def _scenes(*lead):
    rng = np.random.default_rng(sum(lead))
    center = rng.uniform(-0.8, 0.8, (*lead, 2, 2)).astype(np.float32)
    flags = np.zeros((*lead, 2), bool)
    return Scene(center, np.full_like(center, 0.3), flags.astype(np.int32), flags, flags)


def _judged(kind, *lead):
    """States without progress, of one kind."""
    return Judged(_scenes(*lead), np.zeros(lead), np.full(lead, KINDS.index(kind)))


def findings(best="gradient search"):
    """The audit; the best state without progress is found by `best`. Of an intruder inside there
    is one state, found by the search; all others have nothing done."""
    pairs = np.array([[[1, 2, 3, 4, 4]], [[0, 0, 0, 0, 3]]], np.int32)
    factor = np.array([[FACTORS.index(f) for f in FACTOR]], np.int32)
    score = np.array([SCORE], np.float32)
    states = States(
        Battery(_scenes(1, 5), score, factor, *pairs, pairs[0]),
        np.where(score < 1, KINDS.index("nothing done"), -1), score == 1,
        _judged("nothing done", 1, 2, 1, 2, 2), _judged("nothing done", 1, 2, 2),
        _scenes(1, 4), np.ones((1, 4), bool), np.zeros((1, 2), np.int32),
    )  # fmt: skip
    paid = lambda kind, *lead: np.full(lead, -0.05 if kind == best else -0.6)  # noqa: E731
    rewards = Rewards(
        np.array([PAID]),
        np.linspace(-1, -0.06, 8).reshape(1, 2, 1, 2, 2) if best != "one object moved" else
        paid("one object moved", 1, 2, 1, 2, 2),
        paid("targets pushed", 1, 2, 2),
        np.array([[-0.1, -0.05, 0.0, -0.25]]),
    )  # fmt: skip
    found = np.full((1, 3, len(KINDS)), -np.inf)
    found[..., KINDS.index("nothing done")] = paid("gradient search", 1, 3)
    found[0, 1, KINDS.index("intruder inside")] = -0.02
    score = np.where(np.arange(len(KINDS)) == KINDS.index("intruder inside"), 0.5, 0.0)
    found = Found(_scenes(*found.shape), np.broadcast_to(score, found.shape), found)
    misranked = np.full(len(KINDS), np.nan)
    misranked[KINDS.index("nothing done")] = 0.25
    misranked[KINDS.index("intruder inside")] = 0.5
    accuracy = np.where(np.isin(FACTORS, FACTOR), 0.9, np.nan)
    measures = Measures(
        **{name: np.float32(value) for name, value in NUMBERS.items()}, misranked=misranked,
        factor_accuracy=accuracy, worst_pair=np.array([0, 3, 4]), alone_share=np.array([0.25]),
        finite=np.array(True),
    )  # fmt: skip
    task = types.SimpleNamespace(movable=(1,), robots=(), half_extent=1.0)
    return Findings(states, Audit(measures, rewards, found), ("goal", "shoe <b>"), task)
