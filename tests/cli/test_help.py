"""Help of a whole run, completion and version: what a person types before anything else."""

import shutil
import subprocess

import pytest

import gril_jax
from gril_jax.cli import help_page, main
from gril_jax.config import RunConfig
from gril_jax.config.command_line import options

WORK = ("--resume", "--hard-negatives", "--dry-run", "--join")  # of verbs, and of no configuration


def _said(capsys, *args):
    assert main.main(args) == 0
    return capsys.readouterr().out


def test_the_short_help_of_a_run_has_what_matters(capsys):
    out = _said(capsys, "train", "--help")
    first = out.splitlines()[0]
    assert first == (
        "usage: gril train [CONFIG] [--task FILE:make] [--demos SET] [--resume RUN] [options]"
    )
    listed = [line.split()[0] for line in out.splitlines() if line.startswith("  --")]
    assert 18 <= len(listed) <= 24
    assert "--ppo.num-timesteps" in listed
    assert "--help-all" in listed


def test_the_full_help_has_every_option(capsys):
    out = _said(capsys, "train", "--help-all")
    assert [name for name in options(RunConfig) if name not in out] == []


def test_a_reward_has_no_options_of_policies(capsys):
    for option in ("--help", "--help-all"):
        out = _said(capsys, "pretrain", option)
        assert "--ppo." not in out
        assert "--sac." not in out
        assert "--pretrain.steps" in out


@pytest.mark.parametrize("study", [(), ("table1",), ("suite",)])
def test_the_short_help_of_a_sweep_names_its_own_options_first(study, capsys):
    usage, *lines = _said(capsys, "sweep", *study, "--help").splitlines()
    assert usage.startswith("usage: gril sweep [CONFIG] [--")
    assert "--resume" in usage
    listed = [line.split()[0] for line in lines if line.startswith("  --")]
    assert listed.index("--seeds") < listed.index("--out")
    assert {"--rows", "--quick", "--devices", "--task", "--demos"} <= {*listed}


@pytest.mark.parametrize("sections", [help_page.TRAIN, help_page.PRETRAIN, help_page.SWEEP])
def test_what_the_short_help_names_exists(sections):
    for name in (name for names in sections.values() for name in names):
        assert name in options(RunConfig) or name.split()[0] in WORK


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
    done = subprocess.run(
        ["bash", "-c", code + 'printf "%s\\n" "${COMPREPLY[@]}"'], capture_output=True, text=True
    )
    assert done.stdout.split() == found


def test_a_shell_that_is_not_known_is_refused(capsys):
    for shell in (["powershell"], []):
        assert main.main(["--tyro-print-completion", *shell]) == 2
        assert "must be followed by one of bash, zsh, fish, tcsh" in capsys.readouterr().err


def test_a_dry_run_is_for_a_new_run(capsys):
    assert main.main(["train", "--dry-run", "--resume", "run"]) == 2
    assert "--dry-run is for a new run" in capsys.readouterr().err
