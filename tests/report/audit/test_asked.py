"""A run's audit in its report: sound or not, said in the tile, the verdict and the last line."""

import pytest

from gril_jax.errors import RunError
from gril_jax.report.audit import asked
from gril_jax.report.headline import audit_tiles, verdict

SOUND = {
    "order_accuracy": 0.999, "hack_gap": 0.5, "touch_share": 0.01, "push_share": 0.47,
    "outbid_share": 0.16,
}  # fmt: skip
WORKED = {"tau": 0.8, "success": 1.0, "starts": 256, "variant": "jitter", "eval_episodes": 256}


def _results(**changes):
    return WORKED | {"audit": SOUND | changes}


def test_a_sound_reward_is_called_so_with_its_numbers():
    (tile,) = audit_tiles(_results())
    assert tile.value == "sound"
    assert tile.note == "order 0.999; hack gap 0.50; touch 0.01; push 0.47; outbid 0.16"
    assert verdict(_results()).grade == "good"
    assert asked.sentence(_results()) == f"audit: the reward is sound ({tile.note})"


@pytest.mark.parametrize(("name", "value"), [("hack_gap", -0.1), ("touch_share", None)])
def test_a_fault_or_an_unknown_number_is_not_sound_and_spoils_the_verdict(name, value):
    results = _results(**{name: value})
    (tile,) = audit_tiles(results)
    assert tile.value == "not sound"
    assert f"not {asked.ASKED[name].bound}" in tile.note
    found = verdict(results)
    assert found.grade == "fair"
    assert found.text.endswith("But its reward is not sound.")


def test_a_reward_without_an_audit_says_so_and_a_run_without_a_reward_has_no_tile():
    assert audit_tiles(WORKED)[0].value == "not audited"
    assert asked.sentence(WORKED).startswith("audit: none")
    assert audit_tiles({}) == []


def test_a_number_that_is_none_is_refused():
    with pytest.raises(RunError, match="audit: hack_gap must be a number"):
        audit_tiles(_results(hack_gap="high"))
