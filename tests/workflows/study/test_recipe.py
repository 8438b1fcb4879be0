"""Studies as YAML, and the fields that their rows change: what is said, refused and shipped."""

import dataclasses
import subprocess
import sys

import pytest
from gril_jax.envs import registry
from hypothesis import given as property_of
from hypothesis import strategies as st

from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.errors import ConfigError
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.given import given
from gril_jax.workflows.study import recipe
from gril_jax.workflows.study.recipe import changed, chosen, difference, scale
from gril_jax.workflows.study.saved import learns

SHIPPED = recipe.names()


def _configs(name):
    made = recipe.load(name)
    base = changed(load(made.base) if made.base else RunConfig(), made.changes)
    return base, {row: changed(base, change) for row, change in made.rows.items()}


@pytest.mark.parametrize("name", SHIPPED)
def test_every_row_of_a_shipped_study_is_a_configuration_that_can_be_built(name):
    made, (_, rows) = recipe.load(name), _configs(name)
    assert chosen(made.default, [*rows])
    for row, config in rows.items():
        assert row == row.strip()
        if learns(config) and config.encoder.kind != "pixels":
            setup.embedding_config(config, 21 if name == "suite" else 7)
        if config.env.reward is not None:
            assert config.env.reward in registry.spec(config.env.name).rewards, row
    for of in made.published.values():
        assert {*of} <= {*rows}


@pytest.mark.parametrize("name", ["table1", "table2", "rates"])
def test_a_smaller_version_has_rows_and_seeds_of_its_own(name):
    whole, small = recipe.load(name), recipe.load(name, quick=True)
    assert small.seeds < whole.seeds
    assert small.rows == whole.rows
    config = load(small.base)
    for row in chosen(small.default, [*small.rows]):
        changed(config, {**small.rows[row], **small.over})


def test_learner_task_and_demonstrations_are_the_same_in_all_rows_of_table_1():
    base, rows = _configs("table1")
    for row in rows.values():
        assert (row.ppo, row.sac, row.demos) == (base.ppo, base.sac, base.demos)
        assert dataclasses.replace(row.env, reward=None) == base.env
    denser = rows["ours audited and denser"]
    for section in ("encoder", "pool", "loss", "pretrain", "run"):
        assert getattr(denser, section) == getattr(base, section)  # the preset's own
    paper = load("match_regions_paper")
    row = rows["ours without robot"]
    assert (row.encoder, row.pool, row.pretrain) == (paper.encoder, paper.pool, paper.pretrain)


def test_shipped_configurations_are_rows_of_table_2_and_ours_of_table_3_is_the_tasks_own():
    rows = recipe.load("table2").rows
    for name, row in (
        ("shoes_in_box", "ours for policies"),
        ("shoes_in_box_paper", "paper's form without robot"),
    ):
        assert changed(load(name), rows[row]) == load(name)
    for row, config in _configs("table3")[1].items():
        if row.startswith("ours on "):
            usual = load("tabletop", ["--env.name", config.env.name])
            for part in ("encoder", "pool", "loss", "pretrain", "run", "ppo"):
                assert getattr(config, part) == getattr(usual, part), part


@pytest.mark.parametrize("name", ["ladder", "ladder_tabletop"])
def test_a_row_gives_the_learner_the_assistance_of_its_name(name):
    for row, config in _configs(name)[1].items():
        assert given(config).assistance == row.rpartition(": ")[2], row


def _file(tmp_path, text):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    return str(file)


def test_blocks_extend_each_other_and_a_product_has_a_row_for_each_combination(tmp_path):
    made = recipe.load(_file(tmp_path, """
        blocks: {a: {pool.alpha: 1, loss.touch: 0.1}, b: {extends: a, loss.touch: 0.2}}
        rows: {one: {extends: [b], pool.alpha: 3}, two: }
        product:
          join: " on "
          of: [{x: {ppo.num_timesteps: x2}, y: {extends: a}}, {z: {ppo.num_timesteps: x0.5}, w: }]
          except: [y on *]
    """))  # fmt: skip
    assert made.name == "mine"
    assert dict(made.rows) == {
        "one": {"pool.alpha": 3, "loss.touch": 0.2},
        "two": {},
        "x on z": {"ppo.num_timesteps": "x1.0"},
        "x on w": {"ppo.num_timesteps": "x2"},
    }
    assert recipe.is_study(str(tmp_path / "mine.yaml"))
    assert not recipe.is_study("quickstart")
    assert not recipe.is_study(_file(tmp_path, "env: {name: match_regions}"))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("rows: {a: {}}\nseed: 3", r"no key 'seed' \(did you mean seeds\?\)"),
        ("rows: [a]", "rows must hold names"),
        ("seeds: 3", "has no rows"),
        ("rows: {a: {extends: b}}", "'a' extends 'b', but there is no such block"),
        ("rows: {a: {extends: b}}\nblocks: {b: {extends: b}}", "'b' extends itself"),
        ("rows: {'a, b': {}}", "'a, b' has a comma"),
        ("rows: {a: {}}\nmeasure: {taste: }", "measure has 'taste', but must have of profiles"),
        ("rows: {a: {}}\nmeasure: {audit: {ascent: 3}}", "measure.audit has no option 'ascent'"),
        ("rows: {a: {}, a: {}}", "'a' is given twice"),
        ("rows: {a: {}", "is not YAML"),
        ("- a", "must hold sections"),
    ],
)
def test_what_is_no_study_is_one_sentence_that_names_the_file(tmp_path, text, fault):
    with pytest.raises(ConfigError, match=fault) as error:
        recipe.load(_file(tmp_path, text))
    assert str(error.value).startswith(str(tmp_path))
    assert "\n" not in str(error.value)


def test_a_study_without_a_smaller_version_says_so(tmp_path):
    with pytest.raises(ConfigError, match="no use for --quick"):
        recipe.load(_file(tmp_path, "rows: {a: }"), quick=True)


def test_reading_a_study_imports_neither_jax_nor_mujoco():
    code = "import sys; from gril_jax.workflows.study import recipe, saved\n"
    code += "recipe.load('suite'); print({'jax', 'mujoco', 'numpy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "set()", done.stderr


# --- fields

ROWS = ("plain", "fancy", "fancy at level A")
CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "pool.alpha": st.integers(1, 9) | st.floats(0.5, 9.0),
        "loss.lambda": st.integers(0, 3),
        "ppo.hidden": st.lists(st.integers(1, 64), min_size=1, max_size=3),
        "pool.noise": st.none() | st.floats(0.0, 0.1),
        "encoder.relations": st.booleans(),
        "run.reward": st.sampled_from(["learned", "environmental"]),
    },
)


@property_of(CHANGES)
def test_a_difference_makes_the_one_of_the_other(change):
    base = RunConfig()
    config = changed(base, change)
    found = difference(base, config)
    assert changed(base, found) == config
    assert {path.rstrip("_") for path in found} <= {*change}
    for section in dataclasses.fields(base):
        for field, value in vars(getattr(config, section.name)).items():
            usual = getattr(getattr(base, section.name), field)
            if usual is not None and value is not None:
                assert type(value) is type(usual), field


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"pool.alpha": 0.0}, r"pool\.alpha is 0"),
        ({"pool.alphas": 1}, r"no field 'pool\.alphas' \(did you mean pool\.alpha\?\)"),
        ({"poll.alpha": 1}, r"no field 'poll\.alpha' \(did you mean"),
        ({"pool.alpha": "high"}, "must be of the kind float"),
        ({"pretrain.steps": 1.5}, "must be of the kind int"),
        ({"pretrain.steps": True}, "must be of the kind int"),
        ({"encoder.kind": "papre"}, "must be one of 'paper'"),
        ({"encoder.relations": 1}, "must be of the kind bool"),
    ],
)
def test_what_no_field_takes_is_refused(change, fault):
    with pytest.raises(ConfigError, match=fault):
        changed(RunConfig(), change)


def test_a_factor_is_of_the_configuration_s_own_number():
    base = RunConfig()
    found = changed(base, {"ppo.num_timesteps": "x0.5", "pool.alpha": "x2"})
    assert found.ppo.num_timesteps == base.ppo.num_timesteps // 2
    assert found.pool.alpha == 2 * base.pool.alpha
    assert [scale(x) for x in ("x0.5", "xirl", 3, None)] == [0.5, None, None, None]


def test_rows_come_in_the_order_of_their_names_and_patterns_each_once():
    assert chosen(["fancy", "plain"], ROWS) == ["fancy", "plain"]
    assert chosen(["fancy*", "*"], ROWS) == ["fancy", "fancy at level A", "plain"]
    with pytest.raises(ConfigError, match=r"names 'fanci' \(did you mean fancy\?\), but the rows"):
        chosen(["fanci"], ROWS)
