"""A hundred kill -9, in chains over verbs and studies: nothing is lost, and nothing differs."""

import random
import shutil
import signal

import pytest
from support import new_task
from support.killed import killer
from support.run_folders import differing
from support.tiny_runs import VERBS, command

KILLS = {
    "quickstart": 20, "train": 20, "sac": 10, "pretrain": 20, "sweep": 14, "table1": 13,
    "soundness": 13,
}  # fmt: skip
# One that is killed after its results leaves its id in the lock, which nobody holds then; the page
# of a study says when it began.
_MAY_DIFFER = {"lock", "report.html"}
_A_CHAIN = 7  # kills of one run, at the most


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
        args = [command(verb)[0], "--resume", "run"]
        if not (path / "config.yaml").exists():  # no run yet
            shutil.rmtree(path, ignore_errors=True)
            args = command(verb)
        elif (path / "results.json").exists():  # it has finished, but for its page
            if not (path / "reward").exists():  # which tables do not have
                break
            args = ["report", "run"]
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
        may = _MAY_DIFFER if command(verb)[0] == "sweep" else {"lock"}
        assert {*differing(whole / "run", folder / "run")} <= may, (verb, chains)
        shutil.rmtree(folder)
        chains += 1
        print(f"{verb}: {count} kills in {chains} chains", flush=True)
