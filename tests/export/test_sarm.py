"""Files for SARM and its reward-weighted cloning, as lerobot reads them.

Tests with lerobot itself are skipped where it is not installed; `pip install --no-deps lerobot`
with torch, pandas and huggingface_hub is enough for them.
"""

import importlib

import numpy as np
import pytest
from support.lerobot_sets import STORIES, indexed

from gril_jax.export.lerobot_progress import Trace, write_progress

pytest.importorskip("pyarrow")


def _of_lerobot(*modules):
    """The first of lerobot's modules that can be imported: they have moved between releases."""
    for module in modules:
        try:
            return importlib.import_module(module)
        except ImportError as error:
            missing = error
    return pytest.skip(f"lerobot cannot be imported: {missing}")


def test_weights_of_lerobot_follow_our_progress(tmp_path):
    reader = _of_lerobot("lerobot.rewards.sarm.rabc", "lerobot.utils.rabc")
    made, rows = indexed(tmp_path / "data")
    # Up to frame 10, level to 20, down to 30 and level to the end; episode 0 is not known.
    trace = Trace(np.array([-1.0, -0.5, -0.5, -1.0]), np.array([0.0, 1.0, 2.0, 3.0]))
    out = tmp_path / "sarm_progress.parquet"
    write_progress(made, out, {"episode_000001": trace}, source="run")
    weights = reader.RABCWeights(out, chunk_size=5, fallback_weight=0.25)
    index = np.arange(len(rows))
    found, stats = weights.compute_batch_weights({"index": index})
    found = found.cpu().numpy() / found.max().item()
    assert len(weights.progress_lookup) == len(STORIES[1].boxes)
    begin = len(STORIES[0].boxes)
    np.testing.assert_allclose(found[:begin], 0.25, atol=1e-5)
    own = found[begin:]
    assert (own[:10] == 1).all()  # progress follows
    assert ((own[10:16] > 0) & (own[10:16] < 1)).all()  # none follows
    assert (own[16:30] == 0).all()  # it falls
    assert stats["num_zero_weight"] == 14
