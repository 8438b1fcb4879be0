"""The rows of a suite, and what is said where films are missing."""

import dataclasses
from pathlib import Path

import pytest

from gril_jax.config.files import load
from gril_jax.errors import ConfigError, DemoError
from gril_jax.workflows.study.rewards import reward_key
from gril_jax.workflows.study.rows import changed
from gril_jax.workflows.study.suite import rows, variants

CONFIG = load("magical_suite")


def test_every_row_is_a_configuration_of_its_task():
    for name, change in rows.rows(Path("sets"), 4_000_000).items():
        task, reward = rows.parts(name)
        config = changed(CONFIG, change)
        assert rows.row_name(task, reward) == name
        assert config.env.name == task
        assert config.demos.path == f"sets/{task}"
        assert (config.run.reward == "learned") == (reward != rows.SCORE)
        padded = set() if task == "match_regions" else {"padded=True"}
        assert {*config.env.options} == {"physics=magical"} | padded
        if " in " in reward:
            assert config.env.variant == reward.rpartition(" ")[2]
            # Frames of the films are shown as the variant might have drawn them.
            assert config.ppo.video_starts == CONFIG.ppo.video_starts
        assert 2_000_000 <= config.ppo.num_timesteps <= 16_000_000


def test_rows_are_of_the_variants_that_their_tasks_have_and_the_usual_ones_are_among_them():
    for task in rows.TASKS:
        known = {"demo"} | {
            rows.parts(name)[1].rpartition(" in ")[2]
            for name in rows.ROWS
            if name.startswith(f"{task} from films in ")
        }
        assert known == set(variants.known(task))
    assert set(rows.USUAL.split(",")) <= set(rows.ROWS)


def test_a_reward_is_learned_once_for_all_variants():
    made = rows.rows(Path("sets"), 4_000_000)
    one, other = (changed(CONFIG, made[f"find_dupe from {x}"]) for x in ("films", rows.EVERYWHERE))
    assert reward_key(one) == reward_key(other)


def test_tasks_differ_in_their_steps_alone():
    of_tasks = [
        {path for path, value in change.items() if value != first[path]}
        for first in [rows.ROWS["find_dupe from films"]]
        for name, change in rows.ROWS.items()
        if name.endswith(f" {rows.LEARNED}")
    ]
    assert set.union(*of_tasks) == {"env.name", "demos.path", "ppo.num_timesteps"}


def _settings(tmp_path, films):
    chosen = rows.rows(tmp_path / "sets", 1)
    chosen = {"find_dupe from films": chosen["find_dupe from films"]}
    return rows.Settings(chosen, films=films)


def test_without_films_it_says_how_to_get_them(tmp_path):
    for films in (None, str(tmp_path)):
        with pytest.raises(DemoError, match="clone https://github"):
            rows.check_settings(CONFIG, _settings(tmp_path, films))


@pytest.mark.parametrize("film", ["find-dupe/000.mp4", "find_dupe/demo-000.pkl.gz"])
def test_films_are_found_by_their_folder(tmp_path, film):
    (tmp_path / film).parent.mkdir()
    (tmp_path / film).touch()
    rows.check_settings(CONFIG, _settings(tmp_path, str(tmp_path)))
    assert rows.films_of(tmp_path, "find_dupe") == (tmp_path / film).parent


def test_a_set_that_is_there_needs_no_films(tmp_path):
    made = tmp_path / "sets" / "find_dupe" / "demos.json"
    made.parent.mkdir(parents=True)
    made.touch()
    rows.check_settings(CONFIG, _settings(tmp_path, None))


def test_policies_learn_by_ppo(tmp_path):
    run = dataclasses.replace(CONFIG.run, algorithm="sac")
    with pytest.raises(ConfigError, match="must be 'ppo'"):
        rows.check_settings(dataclasses.replace(CONFIG, run=run), _settings(tmp_path, None))
