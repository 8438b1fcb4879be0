"""Configurations that would run code, fill the memory or pass for options."""

import pytest
from support.hostile_home import DEEP, refused

BOMB = "\n".join(
    [
        "a0: &a0 {x: 1}",
        *(f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}" for i in range(1, 9)),
    ]
)
LISTS = "\n".join(
    ["a0: &a0 [1]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9))]
)
YAML = {
    "a call": ("env: !!python/object/apply:os.system ['touch ran']", "not YAML"),
    "a new object": ("env: !!python/object/new:os.system ['touch ran']", "not YAML"),
    "a module": ("env: !!python/module:antigravity", "not YAML"),
    "a name": ("env: {name: !!python/name:os.system }", "not YAML"),
    "merged maps": (BOMB, "'<<'"),
    "lists of lists": (LISTS, "no section 'a0'"),
    "lists in a field": ("env: {targets: [[1]]}", "env"),
    "itself": ("&a [*a]", "sections"),
    "itself as a section": ("env: &a {name: *a}", "single value"),
    "an empty number": ("run: {seed: !!int ''}", "not YAML"),
    "no truth": ("run: {seed: !!bool maybe}", "not YAML"),
    "no date": ("run: {seed: !!timestamp never}", "not YAML"),
    "a number of many digits": (f"run: {{seed: 0x{'f' * 9000}}}", "run.seed"),
    "deep": (DEEP, "not YAML"),
    "an option in a list": ("env: {targets: ['--help']}", "env.targets"),
    "another option in a list": ("env: {targets: ['--run.out=/tmp/x']}", "env.targets"),
    "two documents": ("run: {seed: 1}\n---\nrun: {seed: 2}", "not YAML"),
    "NUL": ("run: {seed: \0}", "not YAML"),
    "a key that is a list": ("? [a, b]\n: 1", "not YAML"),
}  # fmt: skip


@pytest.mark.parametrize("kind", YAML)
def test_a_hostile_configuration_is_refused(home, capsys, kind):
    given, words = YAML[kind]
    (home / "c.yaml").write_text(given)
    refused(home, ["pretrain", "c.yaml", "--out", "new"], words, capsys)
