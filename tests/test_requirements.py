"""The locked requirements: every file that may be installed is known by its digest."""

import json
import re

from support.paths import REPOSITORY

LOCK = (REPOSITORY / "requirements.lock").read_text()
# name==version ; marker \, then the digests of its files
PINS = re.findall(r"^([\w.-]+)==(\S+)([^\\\n]*)((?: \\\n    --hash=\S+)*)\n", LOCK, re.MULTILINE)


def test_every_line_is_a_pin_with_the_digests_of_its_files():
    assert len(PINS) > 80
    for name, version, _, hashes in PINS:
        assert re.fullmatch(r"( \\\n    --hash=sha256:[0-9a-f]{64})+", hashes), (name, version)
    rest = re.sub(r"^([\w.-]+)==(\S+)([^\\\n]*)((?: \\\n    --hash=\S+)*)\n", "", LOCK, flags=re.M)
    assert rest == ""  # no index, path or option


def test_packages_of_compiled_code_have_files_for_several_platforms():
    most = {name: hashes.count("sha256:") for name, _, _, hashes in PINS}
    assert all(most[name] >= 10 for name in ("jaxlib", "numpy", "scipy", "mujoco-core", "av"))


def test_what_make_installs_is_checked_against_them():
    assert "--require-hashes -r requirements.lock" in (REPOSITORY / "Makefile").read_text()


def test_the_bill_of_materials_lists_the_same_packages():
    bill = json.loads((REPOSITORY / "sbom.cdx.json").read_text())
    assert bill["bomFormat"] == "CycloneDX"
    listed = [(part["name"], part["version"]) for part in bill["components"]]
    assert sorted(listed) == sorted((name, version) for name, version, *_ in PINS)
    assert "timestamp" not in bill["metadata"]
    assert "serialNumber" not in bill
