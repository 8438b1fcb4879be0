"""The page of an audit."""

import pytest
from support.audit_findings_made import findings

from gril_jax.errors import RunError
from gril_jax.report.audit.page import write_report


def _write(folder, found):
    results = found.as_json() | {"settings": {"source": "<reward>", "seed": 3}}
    return write_report(folder, found, results, title="Audit of x")


def test_it_is_one_file_with_numbers_pictures_and_states(tmp_path):
    page = _write(tmp_path, findings())
    text = page.read_text()
    assert {p.name for p in tmp_path.iterdir()} == {
        "report.html", "hack.png", "maps.png", "worst_pair.png"
    }  # fmt: skip
    assert text.count("data:image/png;base64,") == 3
    assert "-0.050" in text
    assert "not sound; above 0 is asked" in text
    assert "found by gradient ascent" in text
    assert "&lt;reward&gt;" in text
    assert "<reward>" not in text


def test_without_a_violation_no_pair_is_shown(tmp_path):
    found = findings()
    measures = found.audit.measures
    measures = measures._replace(worst_violation=measures.worst_violation * 0)
    page = _write(tmp_path, found._replace(audit=found.audit._replace(measures=measures)))
    assert "Every pair of states is in its true order" in page.read_text()
    assert not (tmp_path / "worst_pair.png").exists()


def test_a_folder_that_is_gone_is_one_sentence(tmp_path):
    with pytest.raises(RunError, match="cannot be written to"):
        _write(tmp_path / "gone", findings())
