"""`gril VERB`: the command line.

The command line is read, and every path on it looked at, before anything heavy is imported: a
misspelt option is answered at once. The verbs are in `gril_jax.cli`; what they do lives in
`gril_jax.experiments`, imported when the verb runs. Exit codes: 0 done, 1 failed at work, 2 the
command line is wrong, 130 interrupted by Ctrl-C, 143 by SIGTERM.
"""

import os
import sys
from collections.abc import Sequence

from gril_jax.config.command_line import nearest
from gril_jax.errors import ConfigError, GrilError
from gril_jax.runs.interrupt import Interrupted, heard

from . import VERBS
from .arguments import Work

__all__ = ["main"]

_HELP = """\
usage: gril VERB [options]

Learn a reward from demonstration videos without actions, and a policy from the reward.

  quickstart                  a small run from demonstrations to a policy, on a laptop
  train [CONFIG]              the same for any configuration
  pretrain [CONFIG]           the learned reward alone
  sweep [CONFIG] --seeds N    every combination of options with commas, over seeds;
                              --distributed on several hosts
  train|pretrain|sweep --resume RUN   go on with what was cut off, bit for bit
  train|pretrain --hard-negatives RUN[,RUN]   learn from what earlier policies were overpaid for
  ablate [CONFIG]             which choices of the reward's training matter, over seeds
  soundness [CONFIG]          the same by audits and by policies, and whether audits tell success;
                              --resume RUN goes on, --join RUN,RUN makes one table
  table1 [CONFIG]             the paper's Table I and Figure 2: policies with rewards of all kinds;
                              --quick on a laptop, --resume RUN goes on
  table2 [CONFIG]             the paper's Table II: rewards that tell success from failure; --quick,
                              --resume RUN
  demos make [CONFIG]         scripted demonstrations
  demos import-magical DIR    a demonstration set from MAGICAL's public demonstrations
  demos import-videos DIR     a demonstration set from a folder of videos
  eval RUN                    success rate and return of a run's policy
  audit RUN|REWARD            how a reward could be cheated, before a policy finds it
  subtasks RUN                stages found in a run's learned reward, and demonstrations cut at them
  report RUN                  figures and tables of a run
  export-policy RUN           a run's policy as plain NumPy arrays
  export-reward RUN           a run's reward as one file that load_reward reads
  bench losses                the losses and encoders beside those of others, as JSON
  bench replay                the replay buffer beside brax's, alone and for eight seeds
  bench train                 training with and without the learned reward, as JSON
  bench compile               seconds to compile each program of a run, and how many there are
  bench brax, bench sac       our PPO beside brax's own, our SAC beside a loop on the host
  bench known                 PPO and SAC where good returns are known, beside brax's and published
  bench env                   how many control steps a second the task makes here, as JSON
  doctor                      what is installed and what works on this machine

CONFIG is the name of a shipped configuration or the path of a YAML file; RUN is the folder
that a run made. `gril VERB --help` lists the options of a verb.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line and returns the exit code; `sys.argv` where `argv` is None."""
    args = list(sys.argv[1:] if argv is None else argv)
    code = 2
    try:
        with heard():
            work = _plan(args)
            code = 1
            result = work() or 0
        sys.stdout.flush()  # here, where a pipe that is closed can still be answered for
        return result
    except Interrupted as stop:
        print(f"gril: {stop}.", file=sys.stderr)
        return stop.exit_code
    except GrilError as error:
        print(f"gril: {str(error).rstrip('.')}.", file=sys.stderr)
        # What only the task or the devices can refuse is known later, but is a wrong command too.
        return 2 if isinstance(error, ConfigError) else code
    except KeyboardInterrupt:
        print("gril: interrupted.", file=sys.stderr)
        return 130
    except SystemExit as stop:  # tyro has printed the help
        return 0 if stop.code is None else int(stop.code)
    except BrokenPipeError:  # the reader of a pipe has had enough, as in `gril --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _plan(args: list[str]) -> Work:
    """Reads the command line; nothing heavy is imported here."""
    if not args or args[0] in ("-h", "--help"):
        print(_HELP, end="")
        return lambda: 0
    verb, rest = args[0], args[1:]
    if verb in ("demos", "bench"):
        if not rest or rest[0] in ("-h", "--help"):
            print(_HELP, end="")
            return lambda: 0
        verb, rest = f"{verb} {rest[0]}", rest[1:]
    if verb not in VERBS:
        hint = nearest(verb, [*VERBS])
        raise ConfigError(f"there is no verb {verb!r}{hint}: see gril --help")
    return VERBS[verb](rest)


if __name__ == "__main__":
    sys.exit(main())
