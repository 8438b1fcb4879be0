"""A hundred kill -9, in chains over six verbs: nothing is lost, and nothing differs."""

import random
import shutil
import signal

import pytest
from support import new_task
from support.killed import killer
from support.run_folders import differing

_TASK = "reach_task:SPEC"
_TINY = (
    *("--env.name", _TASK, "--env.episode-length", "12", "--encoder.width", "8"),
    *("--encoder.latent", "4", "--encoder.rounds", "1", "--demos.num", "4"),
    *("--demos.num-validation", "2", "--demos.num-failures", "1", "--pretrain.num-videos", "3"),
    *("--pretrain.num-frames", "6", "--pretrain.copies", "0", "--pretrain.ascents", "0"),
    *("--run.checkpoint-every", "0", "--out", "run"),
)
_STEPS = ("--pretrain.steps", "40")
_POLICY = (
    *("--ppo.num-envs", "8", "--ppo.unroll-length", "4", "--ppo.num-timesteps", "320"),
    *("--ppo.num-minibatches", "2", "--ppo.hidden", "8", "--run.eval-episodes", "4"),
    *("--run.updates-per-chunk", "1", "--run.evaluations", "0"),
)
_TWO = ("--seeds", "2")
_AUDIT = ("--starts", "2", "--ascents", "4")
_ROWS = ("--rows", "environmental,ours without robot", "--steps-per-encoder", "40")
# Steps of the first rows of Table I and of soundness are the row's, or the configuration's.
VERBS = {
    "quickstart": ("quickstart", *_TINY, *_STEPS, *_POLICY, "--run.audit", "4"),
    "train": ("train", *_TINY, *_STEPS, *_POLICY),
    "pretrain": ("pretrain", *_TINY, *_STEPS),
    "sweep": (
        "sweep", *_TINY, *_STEPS, *_POLICY, *_TWO, "--reward", "learned,environmental",
    ),
    "table1": ("table1", *_TINY, *_POLICY[:-2], *_TWO, *_AUDIT, *_ROWS),
    "soundness": ("soundness", *_TINY, *_STEPS, *_POLICY, *_TWO, *_AUDIT, "--rows", "paper"),
}  # fmt: skip
# Steps that a row sets for itself are not given, nor are copies that all rows of a table set.
_OF_ROWS = ("--pretrain.copies", "--pretrain.ascents")
KILLS = {"quickstart": 20, "train": 20, "pretrain": 20, "sweep": 14, "table1": 13, "soundness": 13}
_A_CHAIN = 7  # kills of one run, at the most


def command(verb):
    """A small run of a verb."""
    args = [*VERBS[verb]]
    for option in _OF_ROWS if verb in ("table1", "soundness") else ():
        at = args.index(option)
        del args[at : at + 2]
    return args


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """What runs and kills command lines on a task as small as can be."""
    folder = tmp_path_factory.mktemp("task")
    new_task.write(folder, new_task.AUDITED)
    with killer(folder) as found:
        yield found


def chain(killed, verb, folder, draw, most, kills):
    """Kills a run at moments that are drawn until it ends, at most so often; how often it was."""
    for count in range(kills + 1):
        path = folder / "run"
        args = [verb, "--resume", "run"]
        if not (path / "config.yaml").exists():  # no run yet
            shutil.rmtree(path, ignore_errors=True)
            args = command(verb)
        elif (path / "results.json").exists():
            args = ["report", "run"]  # it has finished, but for its page
        change = draw.randrange(1, most) if count < kills else 0
        done = killed.run(folder, args, change=change, delay_s=draw.choice((0, 0.01, 0.1)))
        assert "Traceback" not in done.err, done.err
        if done.code == 0:
            break
        assert (done.code, change > 0) == (-signal.SIGKILL, True), (args, done)
    return count


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
def test_a_run_that_is_killed_again_and_again_leaves_the_folder_of_one_that_is_not(
    killed, tmp_path, verb
):
    whole = tmp_path / "whole"
    done = killed.run(whole, command(verb))
    assert done.code == 0, done
    most, draw = 2 * killed.changes(whole) // 3, random.Random(0)
    count = chains = 0
    while count < KILLS[verb]:
        folder = tmp_path / str(chains)
        count += chain(killed, verb, folder, draw, most, min(_A_CHAIN, KILLS[verb] - count))
        assert differing(whole / "run", folder / "run") == [], (verb, chains)
        shutil.rmtree(folder)
        chains += 1
        print(f"{verb}: {count} kills in {chains} chains", flush=True)
