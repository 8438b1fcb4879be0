"""Help of a whole run, completion and version: what a person types before anything else."""

import shutil
import subprocess

import pytest

import gril_jax
from gril_jax.cli import main
from gril_jax.config import RunConfig
from gril_jax.config.command_line import options


def _said(capsys, *args):
    assert main.main(args) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize(
    ("verb", "own"),
    [
        (["train"], ["--resume", "--hard-negatives", "--dry-run"]),
        (["sweep", "table1"], ["--rows", "--quick", "--devices", "--videos"]),
    ],
)
def test_the_help_of_a_run_tells_its_own_options_and_names_all_others(verb, own, capsys):
    out = _said(capsys, *verb, "--help")
    assert all(f"{name} " in out for name in own)
    paths = {one.path for one in options(RunConfig).values()}
    named = {options(RunConfig)[word].path for word in options(RunConfig) if f"{word} " in out}
    assert named == paths
    assert len(out.splitlines()) < 120


def test_the_help_of_a_section_tells_what_its_options_are(capsys):
    for args in (["train", "--help", "ppo"], ["sweep", "table1", "--help", "ppo"]):
        out = _said(capsys, *args)
        assert "Environments that step together" in out
        assert "--sac." not in out
        assert "12000000" in out or args[0] == "train"  # the configuration's own


def test_a_reward_has_no_options_of_policies(capsys):
    out = _said(capsys, "pretrain", "--help")
    assert "--ppo." not in out
    assert "--sac." not in out
    assert "--pretrain.steps" in out


def test_version(capsys):
    assert _said(capsys, "--version") == f"gril-jax {gril_jax.__version__}\n"


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("gril pretr", ["pretrain"]),
        ("gril demos make --num-v", ["--num-validation"]),
        ("gril demos import-v", ["import-videos"]),
        ("gril train --dry", ["--dry-run"]),
        ("gril export RUN --what p", ["policy"]),
    ],
)
def test_the_tab_key_finishes_words(words, found, capsys):
    if shutil.which("bash") is None:
        pytest.skip("bash is not installed")
    script = _said(capsys, "--tyro-print-completion", "bash")
    last, count = words.split()[-1], len(words.split()) - 1
    code = f"{script}\nCOMP_WORDS=({words}); COMP_CWORD={count}; _tyro_gril gril {last} x\n"
    code += 'printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(["bash"], input=code, capture_output=True, text=True)
    assert done.stdout.split() == found


def test_a_shell_that_is_not_known_is_refused(capsys):
    for shell in (["powershell"], []):
        assert main.main(["--tyro-print-completion", *shell]) == 2
        assert "must be followed by one of bash, zsh, fish, tcsh" in capsys.readouterr().err


def test_a_dry_run_is_for_a_new_run(capsys):
    assert main.main(["train", "--dry-run", "--resume", "run"]) == 2
    assert "--dry-run is for a new run" in capsys.readouterr().err
