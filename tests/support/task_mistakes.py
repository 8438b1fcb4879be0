"""Mistakes in a task of one's own: each replaces a text of `own_task.TASK`, and has words of the
one sentence that `gril check-task` says."""

_RESET = "return self.state(jax.random.uniform(key, (2,), minval=-0.8, maxval=0.8))"
_STEP = "return self.state(jnp.clip(state.data + 0.2 * action, -0.9, 0.9))"
_STATE = 'return State(puck, puck, seen, metrics={"success": (jnp.abs(puck) < 0.3).all()})'
_SEEN = "seen = Objects(center, jnp.full((3, 2), 0.2), jnp.arange(3), jnp.arange(3) == 1)"
_EXPERT = "return -5 * state.data"
_MAKE = "return Task()"
_LENGTH = "action_size, episode_length = 2, 8"

MISTAKES = {
    "make exits": (_MAKE, "raise SystemExit(0)", "make failed at line 25: it called sys.exit(0)"),
    "make exits with words": (_MAKE, "raise SystemExit('no')", "it called sys.exit('no')"),
    "reset exits": (_RESET, "raise SystemExit(3)", "line 11: it called sys.exit(3)"),
    "step exits": (_STEP, "raise SystemExit(0)", "line 14: it called sys.exit(0)"),
    "the expert exits": (_EXPERT, "raise SystemExit('bye')", "line 22: it called sys.exit('bye')"),
    "step has another dtype": (
        _STEP, f"{_STEP}._replace(data=state.data.astype(jnp.float16))",
        "state.data is float32 (2,) after reset and float16 (2,) after step",
    ),
    "the expert raises": (_EXPERT, "return 1 / 0", "line 22: ZeroDivisionError"),
    "the expert's action is too long": (
        _EXPERT, "return jnp.zeros(3)", "expert returns an action of the shape (3,), but",
    ),
    "the expert gives words": (_EXPERT, "return 'left'", "expert failed with ValueError"),
    "the expert gives NaN": (_EXPERT, "return state.data * jnp.nan", "NaN or infinite in the exp"),
    "episodes without end": (
        _LENGTH, "action_size, episode_length = 2, 10**12", "must be a whole number from 1 to 100",
    ),
    "it is always done": (
        _STATE, _STATE.replace("metrics", "done=1.0, metrics"), "episodes end at their first step",
    ),
    "nothing is seen": (_STATE, _STATE.replace("puck, puck,", "puck, puck[:0],"), "be a vector"),
    "labels with a point": (
        _SEEN, _SEEN.replace("jnp.arange(3),", "jnp.arange(3.0),"), "objects.label is float32, but",
    ),
    "all is robot": (_SEEN, _SEEN.replace("== 1", ">= 0"), "objects.is_robot is True for all"),
    "reset forgets to return": (_RESET, "pass", "reset returns a NoneType without `data`"),
    "a method is a number": ("def expert(self, state, key):\n        " + _EXPERT, "expert = 3",
                             "expert is a int, but must be a function"),
    "classes that a terminal obeys": ('"puck")', '"\\x1b[31mpuck")', "must be a tuple of"),
    "metrics are a number": (_STATE, 'return State(puck, puck, seen, metrics=puck)', "has no 'suc"),
    "stages are a list": (_LENGTH, f"stages = [1]\n    {_LENGTH}", "stages is a list, but must be"),
}  # fmt: skip

# Written once the ones above had been mended, to see how many others get a sentence.
KEPT_ASIDE = {
    "reset takes no key": ("def reset(self, key)", "def reset(self)", "reset fails"),
    "step takes no action": ("(self, state, action)", "(self, state)", "step fails"),
    "make needs an argument": ("def make(speed=1.0)", "def make(speed)", "make failed"),
    "step calls itself": (_STEP, "return self.step(state, action)", "RecursionError"),
    "numpy samples the start": (
        _RESET, "import numpy\n        return self.state(jnp.array(numpy.random.rand(2)))", "pure",
    ),
    "a traced value is kept": (
        _RESET, "self.old = getattr(self, 'old', 0) + jax.random.uniform(key, (2,))\n"
        "        return self.state(self.old)", "UnexpectedTracerError",
    ),
    "action_size is text": (_LENGTH, "action_size = '2'", "action_size is '2'"),
    "labels change": (
        _SEEN, _SEEN.replace("jnp.arange(3),", "jnp.array([0, 1, 2 * (puck[0] < 0)]),"),
        "label or is_robot changes",
    ),
    "the expert takes no key": ("expert(self, state, key)", "expert(self, state)", "expert failed"),
    "place gives nothing": (
        "def expert(self", "def place(self, center, size, key):\n        pass\n\n"
        "    def expert(self", "place returns a NoneType",
    ),
    "outlines are text": ("def expert(self", "def outlines(self, data):\n        return 'a'\n\n"
                          "    def expert(self", "outlines"),
    "an error with escapes": (_MAKE, "raise ValueError('\\x1b]0;owned\\x07')", "make failed"),
    "step is a generator": (_STEP, "yield state", "step"),
    "make gives the class": (_MAKE, "return Task", "reset"),
    "a state has words": (_STATE, _STATE.replace("State(puck,", "State((puck, 'x'),"), "reset"),
    "boxes shrink to nothing": (_SEEN, _SEEN.replace(
        "jnp.full((3, 2), 0.2)", "jnp.full((3, 2), 0.2) * (puck[0] < 0.85)"),
        "objects.size gets to 0"),
    "a callback fails at times": (_STEP, "def late(x):\n            assert x[0] < 0.8, 'too far'\n"
        "            return x\n        puck = jnp.clip(state.data + 0.2 * action, -0.9, 0.9)\n"
        "        puck = jax.pure_callback(late, puck, puck, vmap_method='sequential')\n"
        "        return self.state(puck)", "too far"),
    "a property fails": (_LENGTH, f"{_LENGTH}\n    half_extent = property(lambda self: self.gone)",
                         "gone"),
    "the background is a word": (_LENGTH, f"{_LENGTH}\n    background = 'white'", "background is"),
    "half_extent is NaN": (_LENGTH, f"{_LENGTH}\n    half_extent = float('nan')", "half_extent is"),
}  # fmt: skip
