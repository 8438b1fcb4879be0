"""Files of strangers whose digest was made anew after their contents were changed: all refused."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.sealed_faults import FILES

from gril_jax.errors import GrilError, is_printable

_LAX = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
FEW = settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=_LAX)
MANY = settings(max_examples=250, deadline=None, suppress_health_check=_LAX)


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    """A whole file of each kind, which can be read."""
    made = {kind: FILES[kind][0](tmp_path_factory.mktemp("whole")) for kind in FILES}
    for kind, path in made.items():
        FILES[kind][2](path)
    return made


def _refused(kind, whole, folder, draw):
    """Breaks the whole file, and requires that it is refused in one sentence that names it."""
    _, break_it, read = FILES[kind]
    path = break_it(draw, whole, folder)
    with pytest.raises(GrilError) as refused:
        read(path)
    assert str(folder) in str(refused.value)
    assert is_printable(str(refused.value))


@pytest.mark.parametrize("kind", FILES)
@FEW
@given(data=st.data())
def test_a_sealed_fault_is_refused_in_a_sentence(wholes, tmp_path, kind, data):
    _refused(kind, wholes[kind], tmp_path, data.draw)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
@MANY
@given(data=st.data())
def test_a_thousand_sealed_faults_are_refused(wholes, tmp_path, kind, data):
    _refused(kind, wholes[kind], tmp_path, data.draw)
