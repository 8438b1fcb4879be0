"""The plan of a policy's training."""

from hypothesis import given
from hypothesis import strategies as st

from gril_jax.workflows.learning.policies import Plan

COUNTS = st.integers(1, 40)


@given(COUNTS, COUNTS, COUNTS)
def test_chunks_cover_all_updates_and_the_last_one_evaluates(updates, per_chunk, evaluations):
    plan = Plan(updates, per_chunk, evaluations, 1)
    counts = [plan.count(chunk) for chunk in range(plan.chunks)]
    assert sum(counts) == updates == plan.done(plan.chunks)
    assert all(1 <= count <= per_chunk for count in counts)
    due = [plan.examines(chunk) for chunk in range(plan.chunks)]
    assert due[-1]
    assert sum(due) == min(evaluations, sum(due))
    if per_chunk == 1:
        assert sum(due) == min(evaluations, updates)


@given(COUNTS, COUNTS)
def test_without_evaluations_no_chunk_evaluates(updates, per_chunk):
    plan = Plan(updates, per_chunk, 0, 1)
    assert not any(plan.examines(chunk) for chunk in range(plan.chunks))
